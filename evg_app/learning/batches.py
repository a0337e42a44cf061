"""Draw training batches: whole scenes with many queries each; a pure function of (seed, step, scenes)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from evg_app.geometry import WORKSPACE_SIZE, Array
from evg_app.learning.labels import Kind
from evg_app.learning.shards import SceneSample

CLEAR_OF_POSITIVE = 0.010
"""A negative closer than this to a positive says nothing about graspness [m]."""
WEAK_DISTANCE = 0.020
"""Weak negatives are random points farther than this from every positive [m]."""
AROUND = 0.04
"""Standard deviation of the weak negatives drawn around surfaces [m]."""

MIRROR = np.array([-1, 1, 1], dtype=np.float32)
"""Mirrors directions in the plane x = const; positions also need `MIRROR_SHIFT`."""
MIRROR_SHIFT = np.array([WORKSPACE_SIZE, 0, 0], dtype=np.float32)
"""[m]."""
FINGERS_EXCHANGED = np.array([1, -1, 1], dtype=np.float32)
"""On the columns of a mirrored rotation: makes it a rotation again, of the mirror image of the gripper: itself."""


@dataclass(frozen=True)
class BatchSizes:
    """Queries per scene: labelled positives and negatives, weak negatives, occupancy points."""

    positives: int = 96
    negatives: int = 96
    weak: int = 80
    occupancy: int = 512


@dataclass(frozen=True)
class Batch:
    """B scenes; points are in workspace units, centred (p / 0.3 m - 0.5); rotations (3, 3).

    Attributes:
        grid: (B, 1, 40, 40, 40).
        positive, positive_rotation, positive_width: (B, P, 3), (B, P, 3, 3), (B, P) [fraction of 0.3 m].
        negative, negative_rotation: (B, N, 3), (B, N, 3, 3).
        negative_counts: whether the negative counts for graspness. (B, N).
        weak: (B, W, 3); weak_counts: (B, W).
        point, occupied: (B, O, 3), (B, O).
    """

    grid: Tensor
    positive: Tensor
    positive_rotation: Tensor
    positive_width: Tensor
    negative: Tensor
    negative_rotation: Tensor
    negative_counts: Tensor
    weak: Tensor
    weak_counts: Tensor
    point: Tensor
    occupied: Tensor


def draw_batch(scenes: Sequence[SceneSample], sizes: BatchSizes, count: int, seed: Sequence[int]) -> Batch:
    """A batch of `count` random scenes, each with a random stored view, half of them mirrored in x."""
    rng = np.random.default_rng(list(seed))
    chosen = rng.integers(len(scenes), size=count)
    return collate([draw_scene(scenes[i], sizes, rng, mirror=bool(rng.random() < 0.5)) for i in chosen])


def collate(items: Sequence[dict[str, NDArray[np.generic]]]) -> Batch:
    """Stack the scenes of a batch."""
    return Batch(**{k: torch.from_numpy(np.stack([item[k] for item in items])) for k in items[0]})


def draw_scene(
    scene: SceneSample, sizes: BatchSizes, rng: np.random.Generator, mirror: bool = False, view: int | None = None
) -> dict[str, NDArray[np.generic]]:
    """The tensors of one scene as arrays (see `Batch`). Mirroring is exact: the gripper is its own mirror image."""
    view = int(rng.integers(len(scene.grids))) if view is None else view
    grid = scene.grids[view].astype(np.float32) / np.float32(255.0)
    good, bad = np.flatnonzero(scene.kind == Kind.POSITIVE), np.flatnonzero(scene.kind != Kind.POSITIVE)
    good, bad = _draw(good, sizes.positives, rng), _draw(bad, sizes.negatives, rng)
    positives = scene.positives.astype(np.float32)
    weak, weak_counts = _weak_negatives(scene, positives, sizes.weak, rng)
    points = rng.choice(len(scene.points), size=sizes.occupancy, replace=False)
    where = {
        "positive": scene.position[good],
        "negative": scene.position[bad],
        "weak": weak,
        "point": scene.points[points].astype(np.float32),
    }
    rotation = _rotations(scene.rows)
    if mirror:
        grid = grid[::-1]
        where = {k: p * MIRROR + MIRROR_SHIFT for k, p in where.items()}
        rotation = rotation * MIRROR[:, None] * FINGERS_EXCHANGED
    return {k: (p / np.float32(WORKSPACE_SIZE) - np.float32(0.5)).astype(np.float32) for k, p in where.items()} | {
        "grid": np.ascontiguousarray(grid[None]),
        "positive_rotation": rotation[good],
        "positive_width": scene.width[good] / np.float32(WORKSPACE_SIZE),
        "negative_rotation": rotation[bad],
        "negative_counts": _nearest(scene.position[bad], positives) > CLEAR_OF_POSITIVE,
        "weak_counts": weak_counts,
        "occupied": scene.occupied[points].astype(np.float32),
    }


def _draw(index: NDArray[np.int64], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """`count` of `index`, without repetition where there are enough."""
    return rng.choice(index, size=count, replace=len(index) < count)


def _rotations(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rotations (N, 3, 3) from their first two rows (N, 6)."""
    two = rows.reshape(-1, 2, 3)
    third = np.cross(two[:, 0], two[:, 1])
    return np.concatenate([two, third[:, None]], axis=1).astype(np.float32)


def _weak_negatives(
    scene: SceneSample, positives: NDArray[np.float32], count: int, rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Points to be called bad unless near a positive, half uniform, half around surfaces; and which of them count."""
    uniform = rng.random((count, 3)) * WORKSPACE_SIZE
    near_surface = scene.points[len(scene.points) * 7 // 10 :]
    base = near_surface[rng.integers(len(near_surface), size=count)].astype(np.float64)
    around = base + rng.normal(scale=AROUND, size=base.shape)
    points = np.clip(np.concatenate([uniform, around]), 0.0, WORKSPACE_SIZE).astype(np.float32)
    far = _nearest(points, positives) > WEAK_DISTANCE
    order = np.argsort(~far + rng.random(len(far)) * 0.5)[:count]
    return points[order], far[order]


def _nearest(points: NDArray[np.float32], to: NDArray[np.float32]) -> Array:
    """Distance from each point (N, 3) to the nearest of `to` (M, 3) [m]."""
    square = (points**2).sum(1)[:, None] - 2.0 * points @ to.T + (to**2).sum(1)
    nearest: Array = np.sqrt(np.maximum(square.min(axis=1), 0.0)).astype(np.float64)
    return nearest
