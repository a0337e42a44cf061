"""Did the scene change near a place between two depth images of one camera that stood still?"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from evg_app.errors import BadInput
from evg_app.geometry import Array, transform_points
from evg_app.types import Frame

BLOCK = 5
"""A pixel counts as changed when the block of this side around it did [px]: noise and edges change no whole block."""
AGREE = 0.8
"""Share of such a block that must have changed, all nearer or all farther."""


@dataclass(frozen=True)
class SceneChange:
    """What differs near a place.

    Attributes:
        area: of surface that came or went, seen from the camera [m^2].
        compared: share of the earlier image's measured pixels there that the later one measured too: the arm may
            stand in front of the rest.
    """

    area: float
    compared: float


def scene_change(
    before: Frame, after: Frame, T_cam_base: Array, place: Array, radius: float, depth_step: float
) -> SceneChange:
    """Compare two images without the arm's links, pixel by pixel.

    Args:
        before, after: of the same camera at the same pose; depth 0 is not compared.
        T_cam_base: maps the base frame to the camera's. Shape (4, 4).
        place: middle of the region in the base frame [m]. Shape (3,).
        radius: of the region [m]; a pixel belongs to it when its surface is inside, before or after.
        depth_step: depth must change by more than this [m].

    Raises:
        BadInput: the images differ in size.
    """
    if before.depth.shape != after.depth.shape:
        raise BadInput(f"depth images of {before.depth.shape} and {after.depth.shape} pixels cannot be compared")
    middle = transform_points(T_cam_base, place)
    rows, columns = _region(before, middle, radius)
    old, new = (_metres(frame, rows, columns) for frame in (before, after))
    there_old, there_new = (_inside(before, z, rows, columns, middle, radius) for z in (old, new))
    both = (old > 0) & (new > 0)
    near = both & (there_old | there_new)
    area = sum(_solid(near & (sign * (new - old) > depth_step)) for sign in (-1.0, 1.0))
    K, expected = before.intrinsics, int(there_old.sum())
    pixel = old * np.minimum(old, np.where(new > 0, new, old)) / (K.fx * K.fy)
    compared = float((there_old & both).sum()) / expected if expected else 0.0
    return SceneChange(float((area * pixel).sum()), compared)


def _solid(changed: NDArray[np.bool_]) -> NDArray[np.float32]:
    """1 where the block around a changed pixel agrees, else 0."""
    share = ndimage.uniform_filter(changed.astype(np.float32), BLOCK, mode="constant")
    solid: NDArray[np.float32] = (changed & (share >= AGREE)).astype(np.float32)
    return solid


def _metres(frame: Frame, rows: slice, columns: slice) -> NDArray[np.float32]:
    return frame.depth[rows, columns].astype(np.float32) * np.float32(frame.depth_scale)


def _region(frame: Frame, middle: Array, radius: float) -> tuple[slice, slice]:
    """Rows and columns that can see a sphere (camera frame [m]); empty when it is behind the camera."""
    K = frame.intrinsics
    if middle[2] <= radius:
        return slice(0, 0), slice(0, 0)
    spans = []
    for centre, focal, shift, size in ((middle[1], K.fy, K.cy, K.height), (middle[0], K.fx, K.cx, K.width)):
        ends = [(centre + s * radius) / (middle[2] + t * radius) * focal + shift for s in (-1, 1) for t in (-1, 1)]
        spans.append(slice(int(np.clip(min(ends), 0, size)), int(np.clip(max(ends) + 1, 0, size))))
    return spans[0], spans[1]


def _inside(
    frame: Frame, z: NDArray[np.float32], rows: slice, columns: slice, middle: Array, radius: float
) -> NDArray[np.bool_]:
    """Which measured points of an image's part lie in a sphere (camera frame [m])."""
    K = frame.intrinsics
    x = (np.arange(columns.start, columns.stop) - K.cx) / K.fx
    y = (np.arange(rows.start, rows.stop) - K.cy) / K.fy
    gap = (z * x - middle[0]) ** 2 + (z * y[:, None] - middle[1]) ** 2 + (z - middle[2]) ** 2
    inside: NDArray[np.bool_] = (gap < radius**2) & (z > 0)
    return inside
