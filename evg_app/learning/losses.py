"""What EquiIGD is trained to do (spec §3.1), all heads on one encoded scene."""

import torch
import torch.nn.functional as F
from torch import Tensor

from evg_app.learning.batches import Batch
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


def equiigd_losses(model: EquiIGD, batch: Batch, generator: torch.Generator) -> dict[str, Tensor]:
    """The loss terms of a batch, each a scalar, already weighted; their sum is what is minimised.

    `generator` draws the flow's noise and times.
    """
    features = model.encode(batch.grid)
    return {
        "graspness": _graspness(model, features, batch),
        "score": _score(model, features, batch),
        "width": _width(model, features, batch),
        "occupancy": F.binary_cross_entropy_with_logits(model.occupancy(features, batch.point), batch.occupied),
        **_rotation(model, features, batch, generator),
    }


def focal(logit: Tensor, label: Tensor, gamma: float = FOCAL_GAMMA) -> Tensor:
    """Mean focal loss of logits (...) and labels in {0, 1} (spec §3.1)."""
    cross = F.binary_cross_entropy_with_logits(logit, label, reduction="none")
    miss = label + (1.0 - 2.0 * label) * torch.sigmoid(logit)
    return (miss**gamma * cross).mean()


def rotation_distance(a: Tensor, b: Tensor) -> Tensor:
    """sin^2 of half the angle between rotations (..., 3, 3), the smaller over the antipodal twins of b. (...)."""
    return torch.minimum(_half_sine(a, b), _half_sine(a, flip(b)))


def _half_sine(a: Tensor, b: Tensor) -> Tensor:
    return (3.0 - (a * b).sum((-1, -2))) / 4.0


def _graspness(model: EquiIGD, features: Features, batch: Batch) -> Tensor:
    """Cross entropy over positives, negatives that are clear of positives, and weak negatives."""
    logit = model.graspness(features, torch.cat([batch.positive, batch.negative, batch.weak], 1))
    ones = torch.ones_like(batch.positive_width)
    label = torch.cat([ones, torch.zeros_like(logit[:, ones.shape[1] :])], 1)
    counts = torch.cat([ones, batch.negative_counts.to(ones.dtype), batch.weak_counts.to(ones.dtype)], 1)
    loss = F.binary_cross_entropy_with_logits(logit, label, reduction="none")
    return (loss * counts).sum() / counts.sum()


def _score(model: EquiIGD, features: Features, batch: Batch) -> Tensor:
    """Focal loss of the classifier on labelled grasps."""
    where = torch.cat([batch.positive, batch.negative], 1)
    rotation = torch.cat([batch.positive_rotation, batch.negative_rotation], 1)
    label = torch.zeros(where.shape[:2])
    label[:, : batch.positive.shape[1]] = 1.0
    return FOCAL_WEIGHT * focal(model.grasp_score(features, where, rotation), label)


def _width(model: EquiIGD, features: Features, batch: Batch) -> Tensor:
    """Squared error of the opening on positives."""
    error = WIDTH_SCALE * (model.width(features, batch.positive) - batch.positive_width)
    return WIDTH_WEIGHT * error.square().mean()


def _rotation(model: EquiIGD, features: Features, batch: Batch, generator: torch.Generator) -> dict[str, Tensor]:
    """Flow matching towards the nearer antipodal twin, and the regressed rotation, on positives."""
    context = model.rotation_context(features, batch.positive)
    noise = torch.randn((*batch.positive.shape[:2], 6), generator=generator)
    t = torch.rand(batch.positive.shape[:2], generator=generator)
    target = nearest_target(noise, batch.positive_rotation)
    moving = t[..., None] * target + (1.0 - t[..., None]) * noise
    flow = F.mse_loss(model.velocity(context, moving, t), target - noise)
    if not model.config.regressed_rotation:
        return {"flow": flow}
    regressed = from_rows(model.regress_from_context(context))
    return {"flow": flow, "regressed": rotation_distance(regressed, batch.positive_rotation).mean()}
