"""What the networks are trained to do (spec §3.1), all heads on one encoded scene."""

import torch
import torch.nn.functional as F
from torch import Tensor

from evg_app.learning.batches import Batch
from evg_app.nets.equigiga import EquiGIGA
from evg_app.nets.equiigd import EquiIGD
from evg_app.nets.features import Features
from evg_app.nets.flow import nearest_target
from evg_app.nets.rotation import flip, from_rows

FOCAL_GAMMA = 2.0
"""Exponent of the classifier's focal loss."""
FOCAL_WEIGHT = 4.0
"""Brings the focal loss to the size of the others (its gradient at 0.5 is a quarter of BCE's)."""
WIDTH_WEIGHT, WIDTH_SCALE = 0.01, 40.0
"""Weight and scale of the width's squared error (spec §3.1)."""


Network = EquiIGD | EquiGIGA


def losses_of(model: Network, batch: Batch, generator: torch.Generator) -> dict[str, Tensor]:
    """The loss terms of a batch, each a scalar, already weighted; their sum is what is minimised.

    `generator` draws the flow's noise and times.
    """
    features = model.encode(batch.grid)
    common = {
        "graspness": _graspness(model, features, batch),
        "width": _width(model, features, batch),
        "occupancy": F.binary_cross_entropy_with_logits(model.occupancy(features, batch.point), batch.occupied),
    }
    if isinstance(model, EquiGIGA):
        regressed = from_rows(model.regress_rotation(features, batch.positive))
        return common | {
            "regressed": _mean(rotation_distance(regressed, batch.positive_rotation), batch.positive_counts)
        }
    return common | {"score": _score(model, features, batch)} | _rotation(model, features, batch, generator)


def focal(logit: Tensor, label: Tensor, weight: Tensor, gamma: float = FOCAL_GAMMA) -> Tensor:
    """Focal loss of logits (...) and labels in {0, 1}, mean over the weights (...) (spec §3.1)."""
    cross = F.binary_cross_entropy_with_logits(logit, label, reduction="none")
    miss = label + (1.0 - 2.0 * label) * torch.sigmoid(logit)
    return (miss**gamma * cross * weight).sum() / weight.sum().clamp(min=1.0)


def rotation_distance(a: Tensor, b: Tensor) -> Tensor:
    """sin^2 of half the angle between rotations (..., 3, 3), the smaller over the antipodal twins of b. (...)."""
    return torch.minimum(_half_sine(a, b), _half_sine(a, flip(b)))


def _mean(values: Tensor, counts: Tensor) -> Tensor:
    """Mean of values (B, P) over those that count (B, P); 0 when none does."""
    return (values * counts).sum() / counts.sum().clamp(min=1.0)


def _half_sine(a: Tensor, b: Tensor) -> Tensor:
    return (3.0 - (a * b).sum((-1, -2))) / 4.0


def _graspness(model: Network, features: Features, batch: Batch) -> Tensor:
    """Cross entropy over positives, negatives that are clear of positives, and weak negatives."""
    logit = model.graspness(features, torch.cat([batch.positive, batch.judged, batch.weak], 1))
    ones = torch.ones_like(batch.positive_width)
    label = torch.cat([ones, torch.zeros_like(logit[:, ones.shape[1] :])], 1)
    counts = torch.cat([batch.positive_counts, batch.judged_counts, batch.weak_counts], 1)
    loss = F.binary_cross_entropy_with_logits(logit, label, reduction="none")
    return (loss * counts).sum() / counts.sum()


def _score(model: EquiIGD, features: Features, batch: Batch) -> Tensor:
    """Focal loss of the classifier on labelled grasps, for each of its scores."""
    where = torch.cat([batch.positive, batch.judged], 1)
    rotation = torch.cat([batch.positive_rotation, batch.judged_rotation], 1)
    good = torch.ones((*batch.positive.shape[:2], 2), device=where.device)
    logit = model.grasp_scores(features, where, rotation)
    outputs = logit.shape[-1]
    label = torch.cat([good, batch.judged_label], 1)[..., :outputs]
    counts = batch.positive_counts[..., None].expand_as(good)
    weight = torch.cat([counts, batch.judged_weight], 1)[..., :outputs]
    return FOCAL_WEIGHT * outputs * focal(logit, label, weight)


def _width(model: Network, features: Features, batch: Batch) -> Tensor:
    """Squared error of the opening on positives."""
    error = WIDTH_SCALE * (model.width(features, batch.positive) - batch.positive_width)
    return WIDTH_WEIGHT * _mean(error.square(), batch.positive_counts)


def _rotation(model: EquiIGD, features: Features, batch: Batch, generator: torch.Generator) -> dict[str, Tensor]:
    """Flow matching towards the nearer antipodal twin, and the regressed rotation, on positives."""
    context = model.rotation_context(features, batch.positive)
    device = batch.positive.device
    noise = torch.randn((*batch.positive.shape[:2], 6), generator=generator, device=device)
    t = torch.rand(batch.positive.shape[:2], generator=generator, device=device)
    target = nearest_target(noise, batch.positive_rotation)
    moving = t[..., None] * target + (1.0 - t[..., None]) * noise
    miss = (model.velocity(context, moving, t) - (target - noise)).square().mean(-1)
    flow = _mean(miss, batch.positive_counts)
    if not model.config.regressed_rotation:
        return {"flow": flow}
    regressed = from_rows(model.regress_from_context(context))
    return {
        "flow": flow,
        "regressed": _mean(rotation_distance(regressed, batch.positive_rotation), batch.positive_counts),
    }
