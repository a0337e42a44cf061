"""Remove the robot's own links from a depth image."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import Array, transform_points
from evg_app.perception.tsdf import Depth, checked_scale
from evg_app.types import Capsule, Intrinsics

PADDING = 0.03
"""How much every link is thickened before it is removed [m]: calibration, depth noise and flying pixels."""

__all__ = ["PADDING", "Capsule", "remove_links"]


def remove_links(
    depth: Depth,
    intrinsics: Intrinsics,
    T_cam_base: Array,
    links: Sequence[Capsule],
    padding: float = PADDING,
    depth_scale: float | None = None,
) -> tuple[Depth, NDArray[np.bool_]]:
    """Set the depth to 0 (no measurement) wherever the measured point lies in a padded link.

    Args:
        depth: float32 [m], or uint16 with `depth_scale` [m per unit]. Shape (H, W). Not changed.
        intrinsics: of the depth image.
        T_cam_base: maps the base frame to the camera's. Shape (4, 4).
        links: the arm's links at the moment of exposure.
        padding: [m].
        depth_scale: needed for uint16.

    Returns:
        The filtered copy, and which pixels were removed, bool (H, W).

    Raises:
        BadInput: the image does not fit the intrinsics, or its unit is unknown.
    """
    scale = checked_scale(depth, intrinsics, depth_scale)
    removed = np.zeros(depth.shape, dtype=np.bool_)
    for link in links:
        a, b = transform_points(T_cam_base, np.stack([link.p0, link.p1]))
        _mark(removed, depth, scale, intrinsics, a, b, link.radius + padding)
    filtered = depth.copy()
    filtered[removed] = 0
    return filtered, removed


def _mark(
    removed: NDArray[np.bool_], depth: Depth, scale: float, intrinsics: Intrinsics, a: Array, b: Array, radius: float
) -> None:
    """Mark the pixels whose point lies within `radius` [m] of the segment a-b (camera frame [m])."""
    rows, columns = _region(intrinsics, a, b, radius)
    z = depth[rows, columns].astype(np.float32)
    if z.size == 0:
        return
    z *= np.float32(scale)
    x = (np.arange(columns.start, columns.stop) - intrinsics.cx) / intrinsics.fx
    y = (np.arange(rows.start, rows.stop) - intrinsics.cy) / intrinsics.fy
    removed[rows, columns] |= (_distance_squared(z, x, y, a, b) <= np.float32(radius**2)) & (z > 0)


def _distance_squared(z: NDArray[np.float32], x: Array, y: Array, a: Array, b: Array) -> NDArray[np.float32]:
    """Squared distance [m^2] of the points z * (x, y, 1) to the segment a-b. Shapes (H, W), (W,), (H,) -> (H, W)."""
    squared = z * _outer_sum(x**2, y**2 + 1.0)
    squared -= _outer_sum(2.0 * a[0] * x, 2.0 * (a[1] * y + a[2]))
    squared *= z
    squared += np.float32(a @ a)
    axis = b - a
    length2 = float(axis @ axis)
    if length2 > 0:
        along = z * _outer_sum(axis[0] / length2 * x, (axis[1] * y + axis[2]) / length2)
        along -= np.float32(a @ axis / length2)
        t = np.clip(along, np.float32(0.0), np.float32(1.0))
        squared += t * (t - along - along) * np.float32(length2)
    return squared


def _outer_sum(x: Array, y: Array) -> NDArray[np.float32]:
    """x[None, :] + y[:, None] in float32. Shape (H, W)."""
    return np.add.outer(y.astype(np.float32), x.astype(np.float32))


def _region(intrinsics: Intrinsics, a: Array, b: Array, radius: float) -> tuple[slice, slice]:
    """Rows and columns that can see the capsule; the whole image when it reaches behind the camera."""
    if max(a[2], b[2]) + radius <= 0:
        return slice(0, 0), slice(0, 0)
    if min(a[2], b[2]) - radius <= 1e-3:
        return slice(0, intrinsics.height), slice(0, intrinsics.width)
    columns = _interval(a[0], b[0], a[2], b[2], radius, intrinsics.fx, intrinsics.cx, intrinsics.width)
    rows = _interval(a[1], b[1], a[2], b[2], radius, intrinsics.fy, intrinsics.cy, intrinsics.height)
    return rows, columns


def _interval(x0: float, x1: float, z0: float, z1: float, r: float, focal: float, centre: float, limit: int) -> slice:
    """Pixels of one image axis that the boxes around both end spheres project to; their hull holds the capsule."""
    corners = [(x + dx) / (z + dz) for x, z in ((x0, z0), (x1, z1)) for dx in (-r, r) for dz in (-r, r)]
    low = int(np.floor(min(corners) * focal + centre))
    high = int(np.ceil(max(corners) * focal + centre)) + 1
    return slice(min(max(low, 0), limit), min(max(high, 0), limit))
