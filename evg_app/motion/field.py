"""Distance to the nearest occupied voxel, precomputed: one lookup per sphere."""

from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from evg_app.geometry import Array
from evg_app.types import CollisionVolume

FAR = 10.0
"""Distance that stands for "nothing is occupied" [m]."""
PADDING = 8
"""Voxels around the occupied ones that the field is exact in; further out it is a lower bound."""


class DistanceField:
    """Distance [m] to the nearest occupied voxel's centre; a lower bound outside the volume.

    Unknown space counts as free (the optimistic policy).
    """

    def __init__(self, occupied: NDArray[np.bool_], origin: Array, voxel_size: float) -> None:
        """Transform bool (X, Y, Z) whose voxel (0, 0, 0) has its corner at `origin` [m] in the base frame."""
        self._voxel = voxel_size
        part, first = _cropped(occupied)
        self._origin = np.asarray(origin, dtype=np.float64) + first * voxel_size
        self._occupied = part
        self._top = np.array(part.shape) - 1
        if part.any():
            self._distance = (ndimage.distance_transform_edt(~part) * voxel_size).astype(np.float32)
        else:
            self._distance = np.full(part.shape, FAR, dtype=np.float32)

    @classmethod
    def of(cls, volume: CollisionVolume) -> Self:
        """The field of a volume's occupied voxels."""
        return cls(volume.occupied, volume.origin, volume.voxel_size)

    def without(self, points: Array, voxels: float) -> Self:
        """The field of everything but the voxels whose centre is within `voxels` sides of a point of (P, 3) [m]."""
        index = np.argwhere(self._occupied)
        if len(index) == 0 or len(points) == 0:
            return self
        centers = self._origin + (index + 0.5) * self._voxel
        gap, _ = cKDTree(points).query(centers, distance_upper_bound=voxels * self._voxel)
        part = self._occupied.copy()
        part[tuple(index[np.isfinite(gap)].T)] = False
        return type(self)(part, self._origin, self._voxel)

    def outside(self, center: Array, radius: Array) -> Self:
        """The field of everything but the voxels whose centre is in one of the spheres: (S, 3) and (S,) [m]."""
        index = np.argwhere(self._occupied)
        if len(index) == 0:
            return self
        gap = cdist(self._origin + (index + 0.5) * self._voxel, center) - radius
        part = self._occupied.copy()
        part[tuple(index[gap.min(axis=1) < 0].T)] = False
        return type(self)(part, self._origin, self._voxel)

    def at(self, points: Array) -> Array:
        """Distances [m] of points (..., 3) [m, base frame]. Shape (...)."""
        if points.ndim == 1:
            return np.asarray(self.at(points[None])[0])
        beyond = points * (1.0 / self._voxel) - (self._origin / self._voxel + 0.5)
        nearest = np.minimum(np.maximum(beyond, 0.0), self._top)
        beyond -= nearest
        index = np.rint(nearest).astype(np.intp)
        inside = self._distance[index[..., 0], index[..., 1], index[..., 2]].astype(np.float64)
        square = np.einsum("...i,...i->...", beyond, beyond)
        return np.asarray(np.sqrt(inside * inside + square * self._voxel**2))


def _cropped(occupied: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """The part that holds every occupied voxel, `PADDING` more on each side, and its first index."""
    low, high = [], []
    for axis in range(3):
        used = np.flatnonzero(occupied.any(axis=tuple({0, 1, 2} - {axis})))
        low.append(max(int(used[0]) - PADDING, 0) if len(used) else 0)
        high.append(min(int(used[-1]) + PADDING + 1, occupied.shape[axis]) if len(used) else 1)
    return occupied[tuple(slice(a, b) for a, b in zip(low, high, strict=True))], np.array(low)
