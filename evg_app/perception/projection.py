"""Where the voxel centres of a regular grid fall in a depth image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import GRID_SIZE, VOXEL_SIZE, Array, invert
from evg_app.types import Intrinsics

BORDER = 1e-4
"""Margin [px] that Open3D keeps from the image border."""

F32 = NDArray[np.float32]


@dataclass(frozen=True)
class VoxelPixels:
    """Pixel, depth and ray length of every voxel centre of a grid, flattened in C order of (x, y, z).

    Attributes:
        pixel: flat index v * width + u of the pixel that holds the voxel centre; 0 where not `inside`. Shape (V,).
        inside: whether the voxel centre is in front of the camera and inside the image. Shape (V,).
        z: depth of the voxel centre along the optical axis [m]. Shape (V,).
        ray_factor: distance along the pixel's ray per metre of depth. Shape (V,).
        shape: voxels along x, y and z.
    """

    pixel: NDArray[np.int32]
    inside: NDArray[np.bool_]
    z: F32
    ray_factor: F32
    shape: tuple[int, int, int]

    def unique_pixels(self) -> NDArray[np.int32]:
        """The flat pixel indices that some voxel needs, ascending. All others cannot change the grid."""
        return np.unique(self.pixel[self.inside])


def voxel_pixels(
    intrinsics: Intrinsics,
    T_cam_grid: Array,
    shape: tuple[int, int, int] = (GRID_SIZE, GRID_SIZE, GRID_SIZE),
    voxel_size: float = VOXEL_SIZE,
) -> VoxelPixels:
    """Project the voxel centres (i + 0.5) * voxel_size of a grid into an image; pixel = floor(u + 0.5) (spec §1, §8).

    Args:
        intrinsics: of the depth image; distortion is applied when there is any.
        T_cam_grid: maps the grid's frame (its lower corner) to the camera's. Shape (4, 4).
        shape: voxels along x, y and z.
        voxel_size: side of one voxel [m].
    """
    x, y, z = _camera_coordinates(T_cam_grid, shape, voxel_size)
    front = z > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.float32(1.0) / z
        x *= inverse
        y *= inverse
    undistorted = not any(intrinsics.distortion)
    xd, yd = (x, y) if undistorted else _distort(x, y, intrinsics.distortion)
    u = xd * np.float32(intrinsics.fx) + np.float32(intrinsics.cx + 0.5)
    v = yd * np.float32(intrinsics.fy) + np.float32(intrinsics.cy + 0.5)
    low, right, below = (
        np.float32(BORDER),
        np.float32(intrinsics.width - BORDER),
        np.float32(intrinsics.height - BORDER),
    )
    inside = front & (u >= low) & (u < right) & (v >= low) & (v < below)
    with np.errstate(invalid="ignore"):
        column, row = u.astype(np.int32), v.astype(np.int32)
    pixel = np.where(inside, row * np.int32(intrinsics.width) + column, np.int32(0))
    factor = _ray_factors(intrinsics).take(pixel) if undistorted else np.sqrt(x * x + y * y + np.float32(1.0))
    return VoxelPixels(pixel, inside, z, factor, shape)


def _camera_coordinates(T_cam_grid: Array, shape: tuple[int, int, int], voxel_size: float) -> tuple[F32, F32, F32]:
    """Coordinates of all voxel centres in the camera frame [m], each flat and float32."""
    axes = [(np.arange(n) + 0.5) * voxel_size for n in shape]
    coordinates = []
    for row in np.asarray(T_cam_grid, dtype=np.float64)[:3]:
        plane = (row[0] * axes[0] + row[3])[:, None] + (row[1] * axes[1])[None, :]
        line = (row[2] * axes[2]).astype(np.float32)
        coordinates.append((plane.astype(np.float32)[:, :, None] + line).ravel())
    return coordinates[0], coordinates[1], coordinates[2]


_factor_cache: dict[Intrinsics, F32] = {}


def _ray_factors(intrinsics: Intrinsics) -> F32:
    """Length of the ray through each pixel centre per metre of depth, flat. Cached for the last camera."""
    if intrinsics not in _factor_cache:
        a = ((np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx) ** 2
        b = ((np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy) ** 2
        _factor_cache.clear()
        _factor_cache[intrinsics] = np.sqrt(a[None, :] + b[:, None] + 1.0).astype(np.float32).ravel()
    return _factor_cache[intrinsics]


def _distort(x: F32, y: F32, coefficients: tuple[float, ...]) -> tuple[F32, F32]:
    """Brown-Conrady distortion of normalised image coordinates; beyond 45 degrees off axis nothing is projected."""
    k1, k2, p1, p2, k3 = np.asarray((*coefficients, 0.0, 0.0, 0.0, 0.0, 0.0)[:5], dtype=np.float32)
    r2 = x * x + y * y
    far = r2 > 2.0
    r2 = np.where(far, np.float32(0.0), r2)
    radial = np.float32(1.0) + r2 * (k1 + r2 * (k2 + r2 * k3))
    xy2 = np.float32(2.0) * x * y
    xd = x * radial + p1 * xy2 + p2 * (r2 + np.float32(2.0) * x * x)
    yd = y * radial + p2 * xy2 + p1 * (r2 + np.float32(2.0) * y * y)
    return np.where(far, np.float32(1e6), xd), np.where(far, np.float32(1e6), yd)


def T_cam_grid_from_origin(T_cam_base: Array, origin: Array) -> Array:
    """T_cam_grid of a grid whose lower corner lies at `origin` [m] in the base frame, axes parallel. Shape (4, 4)."""
    T_base_grid = np.eye(4)
    T_base_grid[:3, 3] = origin
    return np.asarray(T_cam_base @ T_base_grid)


def points_in(
    sparse_m: F32, intrinsics: Intrinsics, T_cam_frame: Array, stride: int = 1, depth_trunc: float = 2.0
) -> F32:
    """Valid pixels of `sparse_m` = depth[::stride, ::stride] [m] as points of a frame [m]. Shape (3, N), float32.

    Distortion is ignored: on a depth camera it moves a point by far less than the voxels this feeds.
    """
    T_frame_cam = invert(T_cam_frame)
    R, t = T_frame_cam[:3, :3].astype(np.float32), T_frame_cam[:3, 3:].astype(np.float32)
    a = ((np.arange(sparse_m.shape[1]) * stride - intrinsics.cx) / intrinsics.fx).astype(np.float32)
    b = ((np.arange(sparse_m.shape[0]) * stride - intrinsics.cy) / intrinsics.fy).astype(np.float32)
    valid = (sparse_m > 0) & (sparse_m < np.float32(depth_trunc))
    points_cam = np.stack([(sparse_m * a)[valid], (sparse_m * b[:, None])[valid], sparse_m[valid]])
    points: F32 = R @ points_cam + t
    return points
