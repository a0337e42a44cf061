"""How good a network is on validation scenes: what training reports and cards state."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from evg_app.learning.batches import Batch, BatchSizes, collate, draw_scene
from evg_app.learning.losses import rotation_distance
from evg_app.learning.shards import SceneSample
from evg_app.nets.equiigd import EquiIGD
from evg_app.nets.features import Features
from evg_app.nets.rotation import from_rows

SIZES = BatchSizes(positives=64, negatives=64, weak=64, occupancy=1024)
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
def evaluate(model: EquiIGD, scenes: Sequence[SceneSample], seed: int = 0) -> dict[str, float]:
    """Graspness AP, classifier AP, rotation errors [deg], occupancy IoU, width error [mm].

    Each scene is seen through one of its stored views, the same in every call.
    """
    was_training = model.training
    model.eval()
    rows: list[dict[str, NDArray[np.float64]]] = []
    for i, scene in enumerate(scenes):
        rng = np.random.default_rng([seed, i])
        batch = collate([draw_scene(scene, SIZES, rng, view=i % len(scene.grids))])
        generator = torch.Generator().manual_seed(seed + i)
        rows.append(_scene_row(model, batch, generator))
    model.train(was_training)
    joined = {k: np.concatenate([r[k] for r in rows]) for k in rows[0]}
    wrong = joined["occupancy_wrong"].sum()
    both = joined["occupancy_both"].sum()
    return {
        "graspness_ap": average_precision(joined["graspness"], joined["graspness_label"]),
        "score_ap": average_precision(joined["score"], joined["score_label"]),
        "regressed_deg": float(np.median(joined["regressed"])),
        "flow_deg": float(np.median(joined["flow"])),
        "occupancy_iou": float(both / max(both + wrong, 1.0)),
        "width_mm": float(np.median(joined["width"])),
    }


def _scene_row(model: EquiIGD, batch: Batch, generator: torch.Generator) -> dict[str, NDArray[np.float64]]:
    """Scores, labels and errors of one scene, flat."""
    features = model.encode(batch.grid)
    where = torch.cat([batch.positive, batch.negative, batch.weak], 1)
    counts = torch.cat([torch.ones_like(batch.positive_width).bool(), batch.negative_counts, batch.weak_counts], 1)[0]
    label = torch.zeros(where.shape[1])
    label[: batch.positive.shape[1]] = 1.0
    labelled = batch.positive.shape[1] + batch.negative.shape[1]
    rotation = torch.cat([batch.positive_rotation, batch.negative_rotation], 1)
    score = model.grasp_score(features, where[:, :labelled], rotation)
    inside, truth = model.occupancy(features, batch.point) > 0, batch.occupied > 0.5
    width = (model.width(features, batch.positive) - batch.positive_width).abs() * 300.0
    values = {
        "graspness": model.graspness(features, where)[0][counts],
        "graspness_label": label[counts],
        "score": score[0],
        "score_label": label[:labelled],
        "occupancy_both": (inside & truth).float().sum()[None],
        "occupancy_wrong": (inside ^ truth).float().sum()[None],
        "width": width[0],
        **_rotation_errors(model, features, batch, generator),
    }
    return {k: v.double().numpy() for k, v in values.items()}


def _rotation_errors(
    model: EquiIGD, features: Features, batch: Batch, generator: torch.Generator
) -> dict[str, torch.Tensor]:
    """Angle [deg] of the regressed and of one sampled rotation to the nearest positive within 1 cm."""
    context = model.rotation_context(features, batch.positive)
    noise = torch.randn((*batch.positive.shape[:2], 6), generator=generator)
    proposals = {"flow": model.sample_from_context(context, noise, FLOW_STEPS)}
    if model.config.regressed_rotation:
        proposals["regressed"] = from_rows(model.regress_from_context(context))
    near = torch.cdist(batch.positive[0], batch.positive[0]) < NEIGHBOURHOOD
    errors = {}
    for name, rotation in proposals.items():
        half = rotation_distance(rotation[0][:, None], batch.positive_rotation[0][None])
        best = torch.where(near, half, torch.ones_like(half)).amin(1).clamp(0.0, 1.0)
        errors[name] = 2.0 * torch.rad2deg(torch.arcsin(best.sqrt()))
    errors.setdefault("regressed", torch.full_like(errors["flow"], float("nan")))
    return errors
