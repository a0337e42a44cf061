"""Draw training batches: whole scenes with many queries each; a pure function of (seed, step, scenes)."""

from dataclasses import dataclass

import torch
from torch import Tensor

from evg_app.geometry import WORKSPACE_SIZE
from evg_app.learning.labels import Kind, WithContact
from evg_app.learning.tables import SceneTable

CLEAR_OF_POSITIVE = 0.010
"""A negative closer than this to a positive says nothing about graspness [m]."""
WEAK_DISTANCE = 0.020
"""Weak negatives are random points farther than this from every positive [m]."""
AROUND = 0.04
"""Standard deviation of the weak negatives drawn around surfaces [m]."""


@dataclass(frozen=True)
class BatchSizes:
    """Queries per scene: labelled positives, collisions, slips, tried proposals; weak negatives; occupancy points."""

    positives: int = 96
    collisions: int = 96
    slips: int = 48
    proposals: int = 40
    weak: int = 80
    occupancy: int = 512


@dataclass(frozen=True)
class Batch:
    """B scenes; points are in workspace units, centred (p / 0.3 m - 0.5); rotations (3, 3).

    Attributes:
        grid: (B, 1, 40, 40, 40).
        positive, positive_rotation, positive_width: (B, P, 3), (B, P, 3, 3), (B, P) [fraction of 0.3 m].
        positive_counts: 0 in scenes that have no positive, so that these places are nonsense. (B, P).
        judged, judged_rotation: collisions, slips and proposals. (B, J, 3), (B, J, 3, 3).
        judged_label, judged_weight: success without and with contact on the approach, and what is known. (B, J, 2).
        judged_counts: weight of the judged in graspness, as negatives. (B, J).
        weak: (B, W, 3); weak_counts: (B, W).
        point, occupied: (B, O, 3), (B, O).
    """

    grid: Tensor
    positive: Tensor
    positive_rotation: Tensor
    positive_width: Tensor
    positive_counts: Tensor
    judged: Tensor
    judged_rotation: Tensor
    judged_label: Tensor
    judged_weight: Tensor
    judged_counts: Tensor
    weak: Tensor
    weak_counts: Tensor
    point: Tensor
    occupied: Tensor


def draw_batch(table: SceneTable, sizes: BatchSizes, count: int, generator: torch.Generator) -> Batch:
    """A batch of `count` random scenes, each with a random stored view, turned and mirrored at random."""
    scene = _integers(table.scenes, (count,), generator)
    view = _integers(table.views, (count,), generator)
    mirror = torch.rand((count, 3), generator=generator, device=generator.device) < 0.5
    return draw(table, sizes, scene, view, mirror, generator)


def draw(
    table: SceneTable, sizes: BatchSizes, scene: Tensor, view: Tensor, mirror: Tensor, generator: torch.Generator
) -> Batch:
    """The batch of given scenes and views (B,), mirrored where `mirror` (B, 3) says so: x, y, then x and y exchanged.

    The three make all quarter turns and their mirror images. Mirroring is exact: the gripper is its own mirror image.
    """
    kind, proposed = table.kind[scene], table.proposed[scene]
    good, any_good = _choose((kind == Kind.POSITIVE) & ~proposed, sizes.positives, generator)
    groups = (
        ((kind == Kind.COLLISION) & ~proposed, sizes.collisions),
        ((kind == Kind.SLIP) & ~proposed, sizes.slips),
        (proposed, sizes.proposals),
    )
    drawn = [_choose(mask, n, generator) for mask, n in groups if n]
    judged, there = torch.cat([d[0] for d in drawn], 1), torch.cat([d[1] for d in drawn], 1)
    position = table.position[scene]
    positives = table.positives[scene].float()
    rotation = _rotations(table.rows[scene])
    judged_kind, contact = kind.gather(1, judged), table.contact[scene].gather(1, judged)
    known = torch.stack([there, there & (contact != WithContact.UNKNOWN)], -1)
    succeeds = torch.stack([judged_kind == Kind.POSITIVE, contact == WithContact.HOLDS], -1)
    where_judged = _rows(position, judged)
    far = _nearest(where_judged, positives) > CLEAR_OF_POSITIVE
    weak, weak_counts = _weak_negatives(table, scene, positives, sizes.weak, generator)
    point = _integers(table.points.shape[1], (len(scene), sizes.occupancy), generator)
    places = {
        "positive": _rows(position, good),
        "judged": where_judged,
        "weak": weak,
        "point": _rows(table.points[scene].float(), point),
    }
    grid = table.grids[scene, view].float() / 255.0
    for axis in (0, 1):
        grid = torch.where(mirror[:, axis, None, None, None], grid.flip(1 + axis), grid)
    grid = torch.where(mirror[:, 2, None, None, None], grid.transpose(1, 2), grid)
    rotation = _mirrored(rotation, mirror)
    return Batch(
        **{k: _normalised(p, mirror) for k, p in places.items()},
        grid=grid[:, None],
        positive_rotation=_matrices(_rows(rotation.flatten(2), good)),
        positive_counts=any_good.float(),
        positive_width=table.width[scene].gather(1, good) / WORKSPACE_SIZE,
        judged_rotation=_matrices(_rows(rotation.flatten(2), judged)),
        judged_label=succeeds.float(),
        judged_weight=known.float(),
        judged_counts=(there & far & (judged_kind != Kind.POSITIVE)).float(),
        weak_counts=weak_counts.float(),
        occupied=table.occupied[scene].gather(1, point).float(),
    )


def _integers(below: int, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
    return torch.randint(below, shape, generator=generator, device=generator.device)


def _choose(mask: Tensor, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Per row of `mask` (B, G) `count` members, without repetition where there are enough; and whether any is.

    Returns indices (B, count) and (B, count), False in rows without a member.
    """
    key = torch.rand(mask.shape, generator=generator, device=generator.device).masked_fill(~mask, -1.0)
    order = key.argsort(1, descending=True)
    members = mask.sum(1, keepdim=True)
    place = torch.arange(count, device=mask.device)[None] % members.clamp(min=1)
    return order.gather(1, place), (members > 0).expand(-1, count)


def _rows(values: Tensor, index: Tensor) -> Tensor:
    """Rows of values (B, N, C) at index (B, M). (B, M, C)."""
    return values.gather(1, index[..., None].expand(-1, -1, values.shape[-1]))


def _rotations(rows: Tensor) -> Tensor:
    """Rotations (..., 3, 3) from their first two rows (..., 6)."""
    two = rows.view(*rows.shape[:-1], 2, 3)
    third = torch.linalg.cross(two[..., 0, :], two[..., 1, :])
    return torch.cat([two, third[..., None, :]], -2)


def _matrices(flat: Tensor) -> Tensor:
    """(..., 9) -> (..., 3, 3)."""
    return flat.view(*flat.shape[:-1], 3, 3)


def _mirrored(rotation: Tensor, mirror: Tensor) -> Tensor:
    """Rotations (B, N, 3, 3) of scenes mirrored as `draw` says: their rows, and the fingers exchanged each time."""
    turned = _reflected(rotation, mirror[:, None])
    odd = mirror.sum(1) % 2 == 1
    fingers = torch.where(odd[:, None], rotation.new_tensor([1.0, -1.0, 1.0]), rotation.new_ones(3))
    return turned * fingers[:, None, None]


def _normalised(p: Tensor, mirror: Tensor) -> Tensor:
    """Positions (B, N, 3) [m] in workspace units, centred, mirrored as `draw` says."""
    return _reflected((p / WORKSPACE_SIZE - 0.5)[..., None], mirror[:, None])[..., 0]


def _reflected(columns: Tensor, mirror: Tensor) -> Tensor:
    """Columns of vectors (..., 3, M) reflected as `draw` says; mirror (..., 3)."""
    x, y, z = columns.unbind(-2)
    x, y = torch.where(mirror[..., 0, None], -x, x), torch.where(mirror[..., 1, None], -y, y)
    x, y = torch.where(mirror[..., 2, None], y, x), torch.where(mirror[..., 2, None], x, y)
    return torch.stack([x, y, z], -2)


def _weak_negatives(
    table: SceneTable, scene: Tensor, positives: Tensor, count: int, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Points to be called bad unless near a positive, half uniform, half around surfaces; and which of them count."""
    shape = (len(scene), count, 3)
    uniform = torch.rand(shape, generator=generator, device=generator.device) * WORKSPACE_SIZE
    near_surface = table.points.shape[1] * 7 // 10
    index = near_surface + _integers(table.points.shape[1] - near_surface, shape[:2], generator)
    base = _rows(table.points[scene].float(), index)
    around = base + AROUND * torch.randn(shape, generator=generator, device=generator.device)
    points = torch.cat([uniform, around.clamp(0.0, WORKSPACE_SIZE)], 1)
    far = _nearest(points, positives) > WEAK_DISTANCE
    key = torch.rand(far.shape, generator=generator, device=generator.device) * 0.5 + far
    order = key.argsort(1, descending=True)[:, :count]
    return _rows(points, order), far.gather(1, order)


def _nearest(points: Tensor, to: Tensor) -> Tensor:
    """Distance from each point (B, N, 3) to the nearest of `to` (B, M, 3) [m]. (B, N)."""
    return torch.cdist(points, to).amin(2)
