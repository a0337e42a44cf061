"""Following poses with the least motion of the joints: the elbow stays where it is instead of swinging.

Each step is a weighted least-norm Newton step; joints count by the time they take.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from evg_app.geometry import Array
from evg_app.motion.kinematics import Integers, Kinematics

EVERY = 6
"""Every so many poses are stepped to one after the other; those between are interpolated and corrected together."""
CORRECTIONS = 2
"""Newton steps that correct all poses together."""
DAMPING = 1e-8
"""Keeps singular poses solvable; then the pose is missed and the row becomes NaN."""
MISSED = 1e-5
"""A pose counts as reached within this [m and rad]."""
LARGEST_STEP = 0.3
"""Of one joint in one Newton step [rad]."""


def track(kinematics: Kinematics, q: Array, poses: Array) -> Array:
    """Configurations along poses, each near the one before; NaN from where a pose cannot be reached.

    Args:
        kinematics: of the arm.
        q: where each row starts. Shape (C, 7) [rad].
        poses: T_base_hand along each row, the first near fk(q). Shape (C, K, 4, 4).

    Returns:
        Shape (C, K, 7) [rad]. Joint limits are not looked at.
    """
    knots = np.unique(np.append(np.arange(0, poses.shape[1], EVERY), poses.shape[1] - 1))
    rough = np.full((len(q), len(knots), 7), np.nan)
    wanted = poses.reshape(-1, 4, 4)
    now = q
    with np.errstate(invalid="ignore", over="ignore"):
        for k, index in enumerate(knots):
            now = _newton(kinematics, now, poses[:, index])
            rough[:, k] = now
        flat = _between(knots, rough, poses.shape[1]).reshape(-1, 7)
        for _ in range(CORRECTIONS):
            flat = _newton(kinematics, flat, wanted)
        error = pose_error(kinematics.fk_hand(flat), wanted)
    path = flat.reshape(*poses.shape[:2], 7)
    missed = ~(np.abs(error).max(axis=1) < MISSED).reshape(poses.shape[:2])
    path[np.logical_or.accumulate(missed, axis=1)] = np.nan
    return path


def _between(knots: Integers, rough: Array, count: int) -> Array:
    """A cubic through rows of knots (C, K, 7), at every index. Shape (C, count, 7)."""
    if len(knots) == 1:
        return np.repeat(rough, count, axis=1)
    finite = np.where(np.isfinite(rough), rough, 0.0)
    path: Array = CubicSpline(knots, finite, axis=1)(np.arange(count))
    return path


def _newton(kinematics: Kinematics, q: Array, T_wanted: Array) -> Array:
    """One step from q (N, 7) towards poses (N, 4, 4): poses along a path lie so close that one nearly reaches."""
    frames = kinematics.frames(q)
    T = frames[:, 7] @ kinematics.geometry.T_7_hand
    J = jacobian(frames, T)
    weighted = J * kinematics.speed**2
    square = weighted @ J.transpose(0, 2, 1) + DAMPING * np.eye(6)
    step = weighted.transpose(0, 2, 1) @ np.linalg.solve(square, pose_error(T, T_wanted)[..., None])
    return np.asarray(q + np.clip(step[..., 0], -LARGEST_STEP, LARGEST_STEP))


def pose_error(T: Array, T_wanted: Array) -> Array:
    """Position [m] and rotation vector [rad] from poses (N, 4, 4) to the wanted ones (N or 1, 4, 4). Shape (N, 6)."""
    R = T_wanted[..., :3, :3] @ T[:, :3, :3].transpose(0, 2, 1)
    axis = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, np.trace(R, axis1=1, axis2=2) - 1.0)
    # For small angles axis / 2 is the rotation vector.
    scale = np.where(sine > 1e-8, angle / np.maximum(sine, 1e-12), 0.5)
    return np.concatenate([T_wanted[..., :3, 3] - T[:, :3, 3], axis * scale[:, None]], axis=1)


def jacobian(frames: Array, T_base_hand: Array) -> Array:
    """Of the hand, in the base frame. Shapes (N, 8, 4, 4) and (N, 4, 4) -> (N, 6, 7)."""
    axes = frames[:, 1:, :3, 2]
    arm = T_base_hand[:, None, :3, 3] - frames[:, 1:, :3, 3]
    J = np.empty((len(frames), 6, 7))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        J[:, i] = axes[..., j] * arm[..., k] - axes[..., k] * arm[..., j]
        J[:, 3 + i] = axes[..., i]
    return J
