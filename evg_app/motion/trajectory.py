"""Time a joint path with one-dimensional ruckig along its parameter, and verify what will be sent.

Timing along the path (`timing.py`) keeps the motion on the path that was checked for collisions.
"""

from functools import cache

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.errors import BadInput, LimitViolation, Refused
from evg_app.geometry import Array
from evg_app.motion.kinematics import Kinematics
from evg_app.motion.path import JointPath
from evg_app.motion.timing import Timing, fastest
from evg_app.types import Trajectory

DT = 0.004
"""Sample interval of every trajectory [s]."""
TOLERANCE = 1e-6
"""Relative excess that the verifier forgives."""
MIN_LENGTH = 1e-9
"""A path shorter than this is a stand-still [rad]."""


def limits(robot: RobotConfig) -> tuple[Array, Array, Array]:
    """Velocity [rad/s], acceleration [rad/s^2] and jerk [rad/s^3] that evg-app allows itself. Shape (J,) each."""
    m = robot.limits
    return (
        np.asarray(m.velocity_rad_s) * m.velocity_scale,
        np.asarray(m.acceleration_rad_s2) * m.acceleration_scale,
        np.asarray(m.jerk_rad_s3) * m.jerk_scale,
    )


def time_path(path: JointPath, robot: RobotConfig, share: float = 1.0) -> Trajectory:
    """A fast rest-to-rest trajectory along a path, verified against the robot's limits.

    Args:
        path: where to go.
        robot: for the limits.
        share: of velocity, acceleration and jerk limits that is used, in (0, 1].

    Raises:
        LimitViolation: the path itself leaves the joint limits.
        Refused: no timing keeps the limits.
    """
    if path.length < MIN_LENGTH:
        q = np.repeat(path.at(np.zeros(1)), 2, axis=0)
        return _checked(Trajectory(tuple(robot.joints), DT, q, np.zeros_like(q), np.zeros_like(q)), robot)
    scale = share
    v, a, j = limits(robot)
    for _ in range(6):
        trajectory = _sample(path, fastest(path, (scale * v, scale * a, scale * j)), robot)
        try:
            return _checked(trajectory, robot)
        except LimitViolation as violation:
            if violation.quantity == "position":
                raise
            scale *= 0.85
    raise Refused("no timing of this path keeps velocity, acceleration and jerk limits; check limits in the config")


def _sample(path: JointPath, timing: Timing, robot: RobotConfig) -> Trajectory:
    s, ds, dds = timing.sample(DT)
    s[-1], ds[-1], dds[-1] = path.length, 0.0, 0.0
    s = np.clip(s, 0.0, path.length)
    q, d1, d2 = (path.at(s, n) for n in (0, 1, 2))
    dq = d1 * ds[:, None]
    ddq = d2 * (ds**2)[:, None] + d1 * dds[:, None]
    return Trajectory(tuple(robot.joints), DT, q, dq, ddq)


def _checked(trajectory: Trajectory, robot: RobotConfig) -> Trajectory:
    verify(trajectory, robot)
    for array in (trajectory.q, trajectory.dq, trajectory.ddq):
        array.setflags(write=False)
    return trajectory


@cache
def position_limits(robot: RobotConfig) -> tuple[Array, Array]:
    """Lowest and highest joint positions of the URDF, without margin. Shape (J,) [rad] each."""
    model = Kinematics(robot).model
    return np.asarray(model.lowerPositionLimit), np.asarray(model.upperPositionLimit)


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


def _well_formed(trajectory: Trajectory, robot: RobotConfig) -> None:
    shape = (len(trajectory.q), len(robot.joints))
    if trajectory.joint_names != tuple(robot.joints):
        raise BadInput(f"the trajectory moves {trajectory.joint_names}, the robot has {tuple(robot.joints)}")
    for name in ("q", "dq", "ddq"):
        array = getattr(trajectory, name)
        if array.shape != shape or shape[0] < 2:
            raise BadInput(f"trajectory.{name} has shape {array.shape}, needed is {shape} with at least 2 samples")
        if not np.isfinite(array).all():
            raise BadInput(f"trajectory.{name} holds values that are not finite; nothing was sent")
    if not trajectory.dt > 0:
        raise BadInput(f"the sample interval is {trajectory.dt} s; it must be positive")


def _compare(trajectory: Trajectory, quantity: str, value: Array, limit: Array) -> None:
    excess = np.abs(value) / limit
    row, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
    if excess[row, joint] > 1.0 + TOLERANCE:
        name = trajectory.joint_names[int(joint)]
        raise LimitViolation(name, quantity, float(value[row, joint]), float(limit[joint]))
