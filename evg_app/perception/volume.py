"""Depth images to the coarse collision volume in the base frame: what is seen, what is free, the rest unknown."""

import numpy as np
from numpy.typing import NDArray

from evg_app.errors import BadInput
from evg_app.geometry import WORKSPACE_SIZE, Array, transform_points
from evg_app.perception.projection import T_cam_grid_from_origin, points_in, voxel_pixels
from evg_app.perception.tsdf import DEPTH_TRUNC, Depth, checked_scale, signed_distances
from evg_app.types import CollisionVolume, Frame, Intrinsics

VOLUME_SIZE = 0.8
"""Side of the collision volume [m]."""
VOLUME_VOXEL = 0.0125
"""Side of one of its voxels [m]."""
STRIDE = 3
"""Every STRIDE-th row and column of the image makes surface points."""
MIN_POINTS = 2
"""Surface points that make a voxel occupied: one stray (flying) pixel does not."""
BELOW = 0.1
"""How far the volume reaches below the task frame's origin [m]."""


def volume_origin(T_base_task: Array, size: float = VOLUME_SIZE) -> Array:
    """Corner [m] of a cube centred on the workspace in x and y, from `BELOW` under its origin up. Shape (3,)."""
    centre = transform_points(T_base_task, [WORKSPACE_SIZE / 2, WORKSPACE_SIZE / 2, 0.0])
    return np.asarray(centre - [size / 2, size / 2, BELOW])


class VolumeFusion:
    """Union over several depth images of one still scene."""

    def __init__(self, origin: Array, size: float = VOLUME_SIZE, voxel_size: float = VOLUME_VOXEL) -> None:
        n = int(np.ceil(size / voxel_size - 1e-9))
        self._origin = np.asarray(origin, dtype=np.float64)
        self._voxel = voxel_size
        self._shape = (n, n, n)
        self._observed = np.zeros(n**3, dtype=np.bool_)
        self._count = np.zeros(n**3, dtype=np.intp)

    def add(self, depth: Depth, intrinsics: Intrinsics, T_cam_base: Array, depth_scale: float | None = None) -> None:
        """Integrate one depth image (units and errors as `TsdfFusion.add`); T_cam_base maps base to camera."""
        scale = checked_scale(depth, intrinsics, depth_scale)
        T_cam_grid = T_cam_grid_from_origin(T_cam_base, self._origin)
        pixels = voxel_pixels(intrinsics, T_cam_grid, self._shape, self._voxel)
        _, hit = signed_distances(depth, pixels, self._voxel, scale)
        self._observed |= hit
        sparse = depth[::STRIDE, ::STRIDE].astype(np.float32) * np.float32(scale)
        self._count += self._points_per_voxel(points_in(sparse, intrinsics, T_cam_grid, STRIDE, DEPTH_TRUNC))

    def add_frame(self, frame: Frame, T_cam_base: Array) -> None:
        """Integrate one camera frame; like `add`."""
        self.add(frame.depth, frame.intrinsics, T_cam_base, frame.depth_scale)

    def volume(self) -> CollisionVolume:
        """What was seen so far (read-only arrays)."""
        occupied = (self._count >= MIN_POINTS).reshape(self._shape)
        observed = self._observed.reshape(self._shape) | occupied
        occupied.setflags(write=False)
        observed.setflags(write=False)
        return CollisionVolume(occupied, observed, self._origin, self._voxel)

    def _points_per_voxel(self, points_grid: NDArray[np.float32]) -> NDArray[np.intp]:
        """How many surface points [m, grid frame] fall into each voxel. Shape (V,)."""
        n = self._shape[0]
        x, y, z = points_grid * np.float32(1.0 / self._voxel)
        inside = (x >= 0) & (x < n) & (y >= 0) & (y < n) & (z >= 0) & (z < n)
        i, j, k = (c[inside].astype(np.int32) for c in (x, y, z))
        return np.bincount((i * n + j) * n + k, minlength=n**3)


def fuse_volume(frames: list[tuple[Frame, Array]], T_base_task: Array) -> CollisionVolume:
    """The collision volume around the workspace from camera frames, each with its T_cam_base (4, 4).

    Raises:
        BadInput: no frame was given, or one does not fit its intrinsics.
    """
    if not frames:
        raise BadInput("no frame to fuse into a collision volume; capture at least one")
    fusion = VolumeFusion(volume_origin(T_base_task))
    for frame, T_cam_base in frames:
        fusion.add_frame(frame, T_cam_base)
    return fusion.volume()
