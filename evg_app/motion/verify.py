"""An independent verifier: what is about to be sent, judged by its samples alone."""

from collections.abc import Sequence
from functools import cache
from itertools import pairwise

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.errors import BadInput, LimitViolation
from evg_app.geometry import Array
from evg_app.motion.kinematics import Kinematics
from evg_app.types import Trajectory

TOLERANCE = 1e-6
"""Relative excess that is forgiven."""
LONGEST_DT = 0.01
"""Samples further apart than this hide what happens between them [s]."""
JOIN = 1e-6
"""How far apart the end of one segment and the start of the next may be [rad]."""


def limits(robot: RobotConfig) -> tuple[Array, Array, Array]:
    """Velocity [rad/s], acceleration [rad/s^2] and jerk [rad/s^3] that evg-app allows itself. Shape (J,) each."""
    m = robot.limits
    return (
        np.asarray(m.velocity_rad_s) * m.velocity_scale,
        np.asarray(m.acceleration_rad_s2) * m.acceleration_scale,
        np.asarray(m.jerk_rad_s3) * m.jerk_scale,
    )


@cache
def position_limits(robot: RobotConfig) -> tuple[Array, Array]:
    """Lowest and highest joint positions of URDF or config, without margin. Shape (J,) [rad] each."""
    model = Kinematics(robot).model
    return np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)


def velocity_range(robot: RobotConfig, q: Array) -> tuple[Array, Array]:
    """Lowest and highest velocity allowed at q (M, J): less towards a near end where the arm has that rule. (M, J)."""
    velocity = np.broadcast_to(limits(robot)[0], q.shape)
    if robot.limits.near_ends is None:
        return -velocity, velocity
    down, up = robot.limits.near_ends.velocity(q)
    scale = robot.limits.velocity_scale
    return -np.minimum(velocity, scale * down), np.minimum(velocity, scale * up)


def verify(trajectory: Trajectory, robot: RobotConfig) -> None:
    """Recompute velocity, acceleration and jerk from the position samples alone and compare with the limits.

    The arm is taken to rest before the first and after the last sample. The trajectory's own dq and ddq must keep the
    limits too, and agree with the positions.

    Raises:
        BadInput: wrong joints, shapes or sample interval, or values that are not finite.
        LimitViolation: which joint breaks which limit, by how much.
    """
    _well_formed(trajectory, robot)
    velocity, acceleration, jerk = limits(robot)
    low, high = position_limits(robot)
    middle, half = (low + high) / 2, (high - low) / 2
    dt = trajectory.dt
    rest = np.concatenate(
        [np.repeat(trajectory.q[:1], 3, axis=0), trajectory.q, np.repeat(trajectory.q[-1:], 3, axis=0)]
    )
    first, second, third = (np.diff(rest, n=n, axis=0) / dt**n for n in (1, 2, 3))
    _compare(trajectory, "position", trajectory.q - middle, half)
    _compare(trajectory, "velocity", first, velocity)
    _compare(trajectory, "acceleration", second, acceleration)
    _compare(trajectory, "jerk", third, jerk)
    _compare(trajectory, "velocity", trajectory.dq, velocity)
    _compare(trajectory, "acceleration", trajectory.ddq, acceleration)
    centred = (rest[4:-2] - rest[2:-4]) / (2 * dt)
    _compare(trajectory, "velocity", trajectory.dq - centred, jerk * dt**2 + 1e-6)
    _compare(trajectory, "acceleration", trajectory.ddq - second[2:-2], jerk * dt * 2 + 1e-4)
    if robot.limits.near_ends is not None:
        _near_ends(trajectory, robot, np.diff(trajectory.q, axis=0) / dt)


def verify_joined(parts: Sequence[Trajectory], robot: RobotConfig) -> None:
    """Verify motions that follow each other: each alone, and the samples of all as one stream across the joins.

    Raises:
        BadInput: like `verify`, or different sample intervals.
        LimitViolation: like `verify`, or a part does not start where the one before it ends.
    """
    for part in parts:
        verify(part, robot)
    for before, after in pairwise(parts):
        if after.dt != before.dt:
            raise BadInput(f"motions sampled every {before.dt} s and {after.dt} s cannot follow each other")
        gap = np.abs(after.q[0] - before.q[-1])
        if gap.max() > JOIN:
            joint = int(np.argmax(gap))
            raise LimitViolation(before.joint_names[joint], "position at a join", float(gap[joint]), JOIN)
    whole = (np.concatenate([getattr(part, name) for part in parts]) for name in ("q", "dq", "ddq"))
    verify(Trajectory(parts[0].joint_names, parts[0].dt, *whole), robot)


def _near_ends(trajectory: Trajectory, robot: RobotConfig, velocity: Array) -> None:
    """Velocities between samples (M - 1, J), and each sample's own, against what is allowed at both ends of them."""
    low, high = velocity_range(robot, trajectory.q)
    low_between, high_between = np.maximum(low[:-1], low[1:]), np.minimum(high[:-1], high[1:])
    stacked = (
        np.concatenate([velocity, trajectory.dq]),
        np.concatenate([low_between, low]),
        np.concatenate([high_between, high]),
    )
    value, lowest, highest = stacked
    limit = np.maximum(np.where(value < 0, -lowest, highest), 1e-9)
    _compare(trajectory, "velocity", value, limit)


def _well_formed(trajectory: Trajectory, robot: RobotConfig) -> None:
    """Refuse wrong joints, shapes, sample intervals and values that are not finite."""
    shape = (len(trajectory.q), len(robot.joints))
    if trajectory.joint_names != tuple(robot.joints):
        raise BadInput(f"the trajectory moves {trajectory.joint_names}, the robot has {tuple(robot.joints)}")
    for name in ("q", "dq", "ddq"):
        array = getattr(trajectory, name)
        if array.shape != shape or shape[0] < 2:
            raise BadInput(f"trajectory.{name} has shape {array.shape}, needed is {shape} with at least 2 samples")
        if not np.isfinite(array).all():
            raise BadInput(f"trajectory.{name} holds values that are not finite; nothing was sent")
    if not 0 < trajectory.dt <= LONGEST_DT:
        raise BadInput(f"the sample interval is {trajectory.dt} s; it must be positive and at most {LONGEST_DT} s")


def _compare(trajectory: Trajectory, quantity: str, value: Array, limit: Array) -> None:
    """Refuse the largest excess of |value| over limit, both (M, J)."""
    excess = np.abs(value) / limit
    row, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
    if excess[row, joint] > 1.0 + TOLERANCE:
        name = trajectory.joint_names[int(joint)]
        allowed = np.broadcast_to(limit, excess.shape)[row, joint]
        raise LimitViolation(name, quantity, float(value[row, joint]), float(allowed))
