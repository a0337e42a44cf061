"""Depth images to the 40^3 TSDF grid, in exactly the convention of spec §1 (Open3D's UniformTSDFVolume)."""

import numpy as np
from numpy.typing import NDArray

from evg_app.errors import BadInput
from evg_app.geometry import VOXEL_SIZE, Array
from evg_app.perception.projection import VoxelPixels, voxel_pixels
from evg_app.types import Frame, Intrinsics, TsdfGrid

TRUNCATION = 4 * VOXEL_SIZE
"""Distance at which the signed distance is cut off [m]."""
DEPTH_TRUNC = 2.0
"""Depth from which on a measurement is ignored [m]."""
BAND = 0.98
"""Grid values exist where -BAND <= f < BAND."""

Depth = NDArray[np.float32] | NDArray[np.uint16]


def signed_distances(
    depth: Depth, pixels: VoxelPixels, truncation: float, depth_scale: float = 1.0, depth_trunc: float = DEPTH_TRUNC
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Distance from each voxel centre to the measured surface along its ray, over `truncation`, at most 1.

    Returns:
        f: float32 (V,), meaningless where not `hit`.
        hit: bool (V,), the voxel's pixel has a depth and the voxel is not deeper than `truncation` behind it.
    """
    d = np.ascontiguousarray(depth).ravel().take(pixels.pixel)
    metres = d.astype(np.float32, copy=False)
    if depth_scale != 1.0:
        metres = metres * np.float32(depth_scale)
    f = metres - pixels.z
    f *= pixels.ray_factor
    f *= np.float32(1.0 / truncation)
    hit = pixels.inside & (metres > 0) & (metres < np.float32(depth_trunc)) & (f > -1.0)
    np.minimum(f, np.float32(1.0), out=f)
    return f, hit


class TsdfFusion:
    """Weighted mean of several depth images of one still scene (Open3D's integration rule, weight 1 each)."""

    def __init__(self) -> None:
        self._sum: NDArray[np.float32] | None = None
        self._weight: NDArray[np.float32] | None = None

    def add(self, depth: Depth, intrinsics: Intrinsics, T_cam_task: Array, depth_scale: float | None = None) -> None:
        """Integrate one depth image.

        Args:
            depth: along the optical axis; float32 [m], or uint16 with `depth_scale` [m per unit]. 0 means none.
                Shape (H, W).
            intrinsics: of the depth image.
            T_cam_task: maps the task frame to the camera's. Shape (4, 4).
            depth_scale: needed for uint16.

        Raises:
            BadInput: the image does not fit the intrinsics, or its unit is unknown.
        """
        scale = checked_scale(depth, intrinsics, depth_scale)
        f, hit = signed_distances(depth, voxel_pixels(intrinsics, T_cam_task), TRUNCATION, scale)
        f = np.where(hit, f, np.float32(0.0))
        if self._sum is None or self._weight is None:
            self._sum, self._weight = f, hit.astype(np.float32)
        else:
            self._sum = self._sum + f
            self._weight = self._weight + hit

    def add_frame(self, frame: Frame, T_cam_task: Array) -> None:
        """Integrate one camera frame; like `add`."""
        self.add(frame.depth, frame.intrinsics, T_cam_task, frame.depth_scale)

    def grid(self) -> TsdfGrid:
        """The grid so far (read-only arrays). `observed & (values == 0)` is seen free space.

        Raises:
            BadInput: nothing was added yet.
        """
        if self._sum is None or self._weight is None:
            raise BadInput("no depth image was fused yet; call TsdfFusion.add first")
        f = self._sum / np.maximum(self._weight, np.float32(1.0))
        observed = (self._weight > 0) & (f >= np.float32(-BAND))
        band = observed & (f < np.float32(BAND))
        values = np.where(band, (f + np.float32(1.0)) * np.float32(0.5), np.float32(0.0))
        shape = (round(len(values) ** (1 / 3)),) * 3
        return _frozen(values.reshape(shape), observed.reshape(shape))


def fuse_depth(depth: Depth, intrinsics: Intrinsics, T_cam_task: Array, depth_scale: float | None = None) -> TsdfGrid:
    """The grid of one depth image; arguments and errors as `TsdfFusion.add`."""
    fusion = TsdfFusion()
    fusion.add(depth, intrinsics, T_cam_task, depth_scale)
    return fusion.grid()


def fuse(frames: list[tuple[Frame, Array]]) -> TsdfGrid:
    """The grid of several camera frames, each with its T_cam_task (4, 4); errors as `TsdfFusion`."""
    fusion = TsdfFusion()
    for frame, T_cam_task in frames:
        fusion.add_frame(frame, T_cam_task)
    return fusion.grid()


def checked_scale(depth: Depth, intrinsics: Intrinsics, depth_scale: float | None) -> float:
    """The depth unit [m].

    Raises:
        BadInput: see `TsdfFusion.add`.
    """
    expected = (intrinsics.height, intrinsics.width)
    if depth.shape != expected:
        raise BadInput(f"depth image has shape {depth.shape}, the intrinsics say {expected}; pass the frame's own")
    if depth_scale is not None:
        return float(depth_scale)
    if not np.issubdtype(depth.dtype, np.floating):
        raise BadInput(f"depth of type {depth.dtype} needs depth_scale [m per unit], e.g. 0.001; float means metres")
    return 1.0


def _frozen(values: NDArray[np.float32], observed: NDArray[np.bool_]) -> TsdfGrid:
    """A TsdfGrid whose arrays are read-only."""
    values.setflags(write=False)
    observed.setflags(write=False)
    return TsdfGrid(values, observed)
