"""Rigid transforms, written `T_a_b`: coordinates in frame b to coordinates in frame a.

Frames: base (robot), task (corner of the 0.3 m cube), cam (optical: x right, y down, z forward),
hand (`panda_hand`), tcp, grasp. Transforms are float64 arrays of shape (4, 4) or (N, 4, 4);
quaternions are xyzw. The grasp frame has its origin at the palm side, +z along the approach,
+-y along the closing direction, and the finger tips at z = +0.050 m (spec §1).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

WORKSPACE_SIZE = 0.30
"""Side of the cubic workspace [m] (spec §1)."""
GRID_SIZE = 40
"""Voxels along each side of the TSDF grid."""
VOXEL_SIZE = WORKSPACE_SIZE / GRID_SIZE
"""Side of one TSDF voxel [m]."""
TABLE_HEIGHT = 0.05
"""Height of the table top in the task frame [m]."""
FINGER_DEPTH = 0.05
"""Grasp frame origin to finger tips along the approach [m]."""
MAX_OPENING = 0.08
"""Widest opening of the parallel gripper [m]."""


def translation(x: float, y: float, z: float) -> Array:
    """Transform that translates by (x, y, z) [m]. Shape (4, 4)."""
    T = np.eye(4)
    T[:3, 3] = (x, y, z)
    return T


def rotation_about(axis: str, angle: float) -> Array:
    """Transform that rotates by `angle` [rad] about the coordinate axis "x", "y" or "z". Shape (4, 4)."""
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    T = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    T[i, i], T[i, j], T[j, i], T[j, j] = c, -s, s, c
    return T


T_HAND_GRASP = translation(0.0, 0.0, 0.062)
"""Grasp frame in the hand frame (spec §1)."""
T_GRASP_TCP = translation(0.0, 0.0, 0.0414)
"""Franka's `hand_tcp` in the grasp frame (spec §1)."""
T_GRASP_FLIPPED = rotation_about("z", np.pi)
"""The antipodal twin: the same grasp with the fingers exchanged."""


def make(R: ArrayLike, t: ArrayLike) -> Array:
    """Transforms from rotations and translations. Shapes (..., 3, 3) and (..., 3) -> (..., 4, 4)."""
    R, t = np.asarray(R, dtype=np.float64), np.asarray(t, dtype=np.float64)
    T = np.zeros((*R.shape[:-2], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


def invert(T_a_b: Array) -> Array:
    """T_b_a. Shape (..., 4, 4)."""
    R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return make(R_b_a, -(R_b_a @ T_a_b[..., :3, 3:])[..., 0])


def transform_points(T_a_b: Array, p_b: ArrayLike) -> Array:
    """Points of frame b in frame a. Shapes (4, 4) and (..., 3) -> (..., 3)."""
    return np.asarray(p_b, dtype=np.float64) @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def from_quaternion(q_xyzw: ArrayLike, t: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Transform from a quaternion (x, y, z, w), normalised here, and a translation [m]. Shape (4, 4).

    Raises:
        ValueError: the quaternion has no length.
    """
    q = np.asarray(q_xyzw, dtype=np.float64)
    norm = np.linalg.norm(q)
    if not np.isfinite(norm) or norm < 1e-9:
        raise ValueError(f"quaternion {q.tolist()} cannot be normalised")
    x, y, z, w = q / norm
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return make(R, t)


def to_quaternion(T: Array) -> Array:
    """Quaternion (x, y, z, w), w >= 0, of a transform or rotation. Shape (4,)."""
    R = T[:3, :3]
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], 0, 0, 0],
            [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], 0, 0],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], 0],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], np.trace(R)],
        ]
    )
    _, vectors = np.linalg.eigh(K / 3.0)
    q: Array = vectors[:, -1]
    return -q if q[3] < 0 else q


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
    """T_world_cam of an optical camera frame (x right, y down, z forward) at `eye` [m]. Shape (4, 4)."""
    eye, target = np.asarray(eye, dtype=np.float64), np.asarray(target, dtype=np.float64)
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, np.asarray(up, dtype=np.float64))
    x /= np.linalg.norm(x)
    return make(np.stack([x, np.cross(z, x), z], axis=1), eye)


def camera_on_sphere(origin: ArrayLike, radius: float, theta: float, phi: float) -> Array:
    """T_task_cam of a camera `radius` [m] from `origin` [m], looking at it (spec §4.3).

    `theta` [rad] is the polar angle from straight up, `phi` [rad] the azimuth. Shape (4, 4).
    """
    o = np.asarray(origin, dtype=np.float64)
    direction = [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]
    return look_at(o + radius * np.asarray(direction), o)


def rotation_angle(R_a: Array, R_b: Array) -> Array:
    """Angle [rad] between rotations (or transforms) of equal shape (..., 3, 3) or (..., 4, 4)."""
    relative = np.swapaxes(R_a[..., :3, :3], -1, -2) @ R_b[..., :3, :3]
    cos = (np.trace(relative, axis1=-2, axis2=-1) - 1.0) / 2.0
    angle: Array = np.arccos(np.clip(cos, -1.0, 1.0))
    return angle


def is_transform(T: Array, tolerance: float = 1e-6) -> bool:
    """Whether T (4, 4) is finite, right-handed, orthonormal to `tolerance` and has the last row 0 0 0 1."""
    R = T[:3, :3]
    return bool(
        np.isfinite(T).all()
        and np.abs(R @ R.T - np.eye(3)).max() < tolerance
        and np.linalg.det(R) > 0
        and np.abs(T[3] - [0, 0, 0, 1]).max() < tolerance
    )
