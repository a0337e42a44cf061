"""How good a network is on validation scenes: what training reports and cards state."""

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from evg_app.learning.batches import Batch, BatchSizes, draw
from evg_app.learning.losses import Network, rotation_distance
from evg_app.learning.tables import SceneTable
from evg_app.nets.equiigd import EquiIGD
from evg_app.nets.features import Features
from evg_app.nets.rotation import from_rows

SIZES = BatchSizes(positives=64, collisions=48, slips=24, proposals=24, weak=64, occupancy=1024)
"""Queries per validation scene."""
NEIGHBOURHOOD = 0.010 / 0.3
"""Positives this near to a query (workspace units) are what its rotation is compared with."""
FLOW_STEPS = 5
"""Euler steps of the sampled rotation that is measured."""


def average_precision(score: ArrayLike, label: ArrayLike) -> float:
    """Area under precision over recall of scores (N,) for labels (N,) in {0, 1}; nan without positives."""
    s, y = np.asarray(score, dtype=np.float64), np.asarray(label, dtype=np.float64)
    if y.sum() == 0:
        return float("nan")
    order = np.argsort(-s, kind="stable")
    s, y = s[order], y[order]
    last = np.append(np.flatnonzero(np.diff(s)), len(s) - 1)
    hits = np.cumsum(y)[last]
    precision, recall = hits / (last + 1), hits / y.sum()
    return float((precision * np.diff(recall, prepend=0.0)).sum())


@torch.no_grad()
def evaluate(model: Network, table: SceneTable, count: int | None = None, seed: int = 0) -> dict[str, float]:
    """Graspness AP, classifier AP, rotation errors [deg], occupancy IoU, width error [mm] on the first scenes.

    Each scene is seen through one of its stored views, the same in every call.
    """
    was_training = model.training
    model.eval()
    scenes = min(table.scenes, count or table.scenes)
    rows: list[dict[str, NDArray[np.float64]]] = []
    for i in range(scenes):
        generator = torch.Generator(table.grids.device).manual_seed(seed + i)
        index = torch.tensor([i], device=table.grids.device)
        batch = draw(
            table,
            SIZES,
            index,
            index % table.views,
            torch.zeros((1, 3), dtype=torch.bool, device=table.grids.device),
            generator,
        )
        rows.append(_scene_row(model, batch, generator))
    model.train(was_training)
    joined = {k: np.concatenate([r[k] for r in rows]) for k in rows[0]}
    both, wrong = joined.pop("occupancy_both").sum(), joined.pop("occupancy_wrong").sum()
    answer = {
        f"{name}_ap": average_precision(joined[name], joined[f"{name}_label"])
        for name in ("graspness", "score", "contact", "proposals")
        if name in joined and joined[f"{name}_label"].any()
    }
    answer |= {f"{name}_deg": float(np.median(joined[name])) for name in ("regressed", "flow") if name in joined}
    return answer | {
        "occupancy_iou": float(both / max(both + wrong, 1.0)),
        "width_mm": float(np.median(joined["width"])),
    }


def _scene_row(model: Network, batch: Batch, generator: torch.Generator) -> dict[str, NDArray[np.float64]]:
    """Scores, labels and errors of one scene, flat."""
    features = model.encode(batch.grid)
    where = torch.cat([batch.positive, batch.judged, batch.weak], 1)
    ones = torch.ones_like(batch.positive_width)
    counts = torch.cat([ones, batch.judged_counts, batch.weak_counts], 1)[0] > 0
    label = torch.zeros(where.shape[1], device=where.device)
    label[: batch.positive.shape[1]] = 1.0
    inside, truth = model.occupancy(features, batch.point) > 0, batch.occupied > 0.5
    width = (model.width(features, batch.positive) - batch.positive_width).abs() * 300.0
    values = {
        "graspness": model.graspness(features, where)[0][counts],
        "graspness_label": label[counts],
        "occupancy_both": (inside & truth).float().sum()[None],
        "occupancy_wrong": (inside ^ truth).float().sum()[None],
        "width": width[0],
    }
    if isinstance(model, EquiIGD):
        values |= _scores(model, features, batch) | _rotation_errors(model, features, batch, generator)
    else:
        values["regressed"] = _error(model.rotation(features, batch.positive), batch)
    return {k: v.double().cpu().numpy() for k, v in values.items()}


def _scores(model: EquiIGD, features: Features, batch: Batch) -> dict[str, torch.Tensor]:
    """The classifier's scores and their labels: strict, with contact allowed, and strict on proposals alone."""
    where = torch.cat([batch.positive, batch.judged], 1)
    rotation = torch.cat([batch.positive_rotation, batch.judged_rotation], 1)
    logit = model.grasp_scores(features, where, rotation)[0]
    good = torch.ones((batch.positive.shape[1], 2), device=where.device)
    label, known = torch.cat([good, batch.judged_label[0]]), torch.cat([good, batch.judged_weight[0]]) > 0
    values = {}
    for column, name in enumerate(("score", "contact")[: logit.shape[-1]]):
        values[name] = logit[known[:, column], column]
        values[f"{name}_label"] = label[known[:, column], column]
    tried = known[:, 0].clone()
    tried[: -SIZES.proposals] = False
    return values | {"proposals": logit[tried, 0], "proposals_label": label[tried, 0]}


def _rotation_errors(
    model: EquiIGD, features: Features, batch: Batch, generator: torch.Generator
) -> dict[str, torch.Tensor]:
    """Angle [deg] of the regressed and of one sampled rotation to the nearest positive within 1 cm."""
    context = model.rotation_context(features, batch.positive)
    noise = torch.randn((*batch.positive.shape[:2], 6), generator=generator, device=batch.positive.device)
    errors = {"flow": _error(model.sample_from_context(context, noise, FLOW_STEPS), batch)}
    if model.config.regressed_rotation:
        errors["regressed"] = _error(from_rows(model.regress_from_context(context)), batch)
    return errors


def _error(rotation: torch.Tensor, batch: Batch) -> torch.Tensor:
    """Angle [deg] of rotations (1, P, 3, 3) at the positives to the nearest positive within 1 cm. (P,)."""
    near = torch.cdist(batch.positive[0], batch.positive[0]) < NEIGHBOURHOOD
    half = rotation_distance(rotation[0][:, None], batch.positive_rotation[0][None])
    best = torch.where(near, half, torch.ones_like(half)).amin(1).clamp(0.0, 1.0)
    return 2.0 * torch.rad2deg(torch.arcsin(best.sqrt()))
