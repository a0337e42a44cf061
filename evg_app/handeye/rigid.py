"""Small rigid-body mathematics of the solvers: exponentials, means, displacement over a cube."""

import numpy as np
from scipy.spatial.transform import Rotation

from evg_app.geometry import WORKSPACE_SIZE, Array, invert, make, transform_points


def hat(w: Array) -> Array:
    """Cross-product matrices. Shapes (..., 3) -> (..., 3, 3)."""
    K = np.zeros((*w.shape[:-1], 3, 3))
    K[..., 0, 1], K[..., 0, 2], K[..., 1, 2] = -w[..., 2], w[..., 1], -w[..., 0]
    K[..., 1, 0], K[..., 2, 0], K[..., 2, 1] = w[..., 2], -w[..., 1], w[..., 0]
    return K


def exp(w: Array) -> Array:
    """Rotation matrices of rotation vectors [rad]. Shapes (..., 3) -> (..., 3, 3)."""
    return np.asarray(Rotation.from_rotvec(w).as_matrix())


def log(R: Array) -> Array:
    """Rotation vectors [rad] of rotations or transforms. Shapes (..., 3|4, 3|4) -> (..., 3)."""
    return np.asarray(Rotation.from_matrix(R[..., :3, :3]).as_rotvec())


def right_jacobian(w: Array) -> Array:
    """J with exp(w + d) = exp(w) exp(J d) to first order. Shapes (3,) -> (3, 3)."""
    angle = float(np.linalg.norm(w))
    K = hat(w)
    if angle < 1e-6:
        return np.eye(3) - K / 2
    a, b = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    J: Array = np.eye(3) - a * K + b * K @ K
    return J


def moved(T: Array, step: Array) -> Array:
    """T with its translation moved by step[:3] [m] and turned by exp(step[3:]) in its own frame. Shape (4, 4)."""
    return make(T[:3, :3] @ exp(step[3:]), T[:3, 3] + step[:3])


def mean_transform(T: Array) -> Array:
    """Chordal mean of transforms (N, 4, 4). Shape (4, 4)."""
    R = Rotation.from_matrix(T[:, :3, :3]).mean().as_matrix()
    return make(R, np.median(T[:, :3, 3], axis=0))


def cube_points(T_base_task: Array, steps: int = 4) -> Array:
    """A regular grid over the workspace cube in the base frame [m]. Shape (steps^3, 3)."""
    side = np.linspace(0.0, WORKSPACE_SIZE, steps)
    grid = np.stack(np.meshgrid(side, side, side, indexing="ij"), axis=-1).reshape(-1, 3)
    return transform_points(T_base_task, grid)


def displacement(T_true: Array, T_estimated: Array, points_parent: Array) -> float:
    """RMS distance [m] by which points (P, 3) of the parent frame, seen through T_true, land elsewhere."""
    T = T_estimated @ invert(T_true)
    off = transform_points(T, points_parent) - points_parent
    return float(np.sqrt((off**2).sum(axis=1).mean()))
