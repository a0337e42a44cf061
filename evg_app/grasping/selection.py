"""Which points to ask, which answers to keep: pure functions on arrays, all symmetric under turns about z."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import VOXEL_SIZE, Array
from evg_app.grasping import columns, lattice

Volume = NDArray[np.float32]
Mask = NDArray[np.bool_]

SURFACE_REACH = 0.060
"""Grasp centres are asked for this close to a seen surface [m]: keeps 97-99.6 % of the positives (a VGN-like
surface mask only 29-48 %, as far free space is 0 in this grid)."""
SURFACE_MIN_Z = 0.045
"""Seen surfaces count from this height up [m]: 5 mm below the table top, so that flat objects, and the table they
cannot be told from under depth noise, count. From 1 cm above the table up, 12 of 40 pile rounds ended in "no grasp"."""
CENTRE_MIN_Z = 0.0525
"""Lowest grasp centre [m]. The centre lies 5 cm behind the finger tips: below the table top (0.05) no part of the
hand fits, and a hand 2 cm thick on its side needs 0.06; 0.0525 is the voxel boundary that keeps a margin for noise."""
BORDER = 2
"""Voxels along the cube's four walls where no grasp centre is asked for (spec §5: 2 cm)."""
WIDTH_RANGE = (0.0099, 0.0699)
"""Predicted openings that are believed [m] (spec §1)."""


def surface(values: Volume, min_z: float = SURFACE_MIN_Z, thickness: float = 0.5) -> Mask:
    """Voxels at a seen surface: |f| <= thickness * voxel / truncation, f = 2 v - 1, from height `min_z` [m] up.

    With thickness 0.5 [voxels] the layer is about one voxel thick along the view. Shape (40, 40, 40).
    """
    near: Mask = np.abs(2.0 * values - 1.0) <= thickness / 4.0 + 1e-6
    near[:, :, : round(min_z / VOXEL_SIZE)] = False
    return near


def candidate_mask(values: Volume) -> Mask:
    """Voxels where a grasp centre is worth a question. Shape (40, 40, 40)."""
    seen = surface(values)
    if not seen.any():
        return seen
    mask = columns.within(seen, SURFACE_REACH / VOXEL_SIZE)
    inside = np.zeros_like(mask)
    within_bounds = (slice(BORDER, -BORDER), slice(BORDER, -BORDER), slice(round(CENTRE_MIN_Z / VOXEL_SIZE), None))
    inside[within_bounds] = mask[within_bounds]
    return inside


def smooth(values: Volume, where: Mask, sigma: float = 1.0) -> Volume:
    """Gaussian mean over the voxels `where` values are defined, 0 elsewhere; sigma in voxels."""
    means = _means(values, where, sigma) if sigma > 0 else values
    return means * where


def filled(values: Volume, where: Mask) -> Volume:
    """The values `where` they are defined, elsewhere the Gaussian mean (of one cell) of those around."""
    return np.where(where, values, _means(values, where, 1.0))


def _means(values: Volume, where: Mask, sigma: float) -> Volume:
    """Gaussian mean at each cell of a cube over those `where` values are defined, 0 far from all of them."""
    share = where.astype(np.float32)  # multiplying takes a tenth of the time of choosing
    both = np.stack([values * share, share])
    total, weight = lattice.along_axes(_gaussian(sigma, len(values)), both)
    mean: Volume = np.divide(total, np.maximum(weight, np.float32(1e-12), out=weight), out=total)
    return mean


@lru_cache(maxsize=8)
def _gaussian(sigma: float, length: int) -> NDArray[np.float32]:
    """Gaussian weights between cells of one line, cut off at 3 sigma. Shape (length, length)."""
    distance = np.abs(np.subtract.outer(np.arange(length), np.arange(length)))
    weights = np.where(distance <= int(3.0 * sigma + 0.5), np.exp(-0.5 * (distance / sigma) ** 2), 0.0)
    return weights.astype(np.float32)


def largest_around(values: Volume) -> Volume:
    """The largest of the 3x3x3 cells around each, itself included; outside counts as 0."""
    padded = np.pad(values, 1)
    for _ in range(3):  # along the first axis, which then becomes the last
        padded = np.moveaxis(np.maximum(np.maximum(padded[:-2], padded[2:]), padded[1:-1]), 0, -1)
    return padded


def best(values: NDArray[np.floating[Any]], count: int) -> NDArray[np.intp]:
    """Indices of the `count` largest of a flat array, largest first; ties by index."""
    order: NDArray[np.intp] = np.argsort(-values, kind="stable")
    return order[:count]


def spread(values: NDArray[np.float32], group: NDArray[np.intp], per_group: int, count: int) -> NDArray[np.intp]:
    """`best`, with at most `per_group` members of any group: near neighbours would otherwise take all places.

    Args:
        values, group: value and group of each member. Shape (N,).
        per_group, count: how many of one group, how many in all.
    """
    order = best(values, len(values))
    by_group = np.argsort(group[order], kind="stable")
    sorted_group = group[order][by_group]
    first = np.searchsorted(sorted_group, sorted_group)
    place = np.empty(len(order), dtype=np.intp)
    place[by_group] = np.arange(len(order)) - first
    return order[place < per_group][:count]


def width_mask(width: Array) -> Mask:
    """Which predicted openings [m] the gripper can really take (spec §5.4)."""
    return (width >= WIDTH_RANGE[0]) & (width <= WIDTH_RANGE[1])


def suppress(T_task_grasp: Array, score: Array, radius: float, angle: float) -> NDArray[np.intp]:
    """Greedy non-maximum suppression of near duplicates.

    A grasp goes when a kept, better one lies within `radius` [m] and `angle` [rad], up to the exchange of the fingers.

    Args:
        T_task_grasp: shape (N, 4, 4).
        score: shape (N,).

    Returns:
        Indices kept, best first.
    """
    order: NDArray[np.intp] = np.argsort(-score, kind="stable")
    T = T_task_grasp[order]
    position = T[:, :3, 3]
    length = (position**2).sum(1)
    near = length[:, None] + length[None] - 2.0 * position @ position.T < radius**2
    duplicates = near & (antipodal_cosine(T, T) > np.cos(angle))
    alive = np.ones(len(order), dtype=np.bool_)
    for i in range(len(order)):
        if alive[i]:
            alive[i + 1 :] &= ~duplicates[i, i + 1 :]
    return order[alive]


def antipodal_cosine(T_a: Array, T_b: Array) -> Array:
    """Cosine of the angle between all pairs of grasps, up to the exchange of the fingers. (N,4,4), (M,4,4) -> (N,M)."""
    a, b = T_a[:, :3, :3].reshape(-1, 9), T_b[:, :3, :3].reshape(-1, 9)
    exchanged = b * np.array([-1.0, -1.0, 1.0] * 3)
    cosine: Array = (np.maximum(a @ b.T, a @ exchanged.T) - 1.0) / 2.0
    return cosine
