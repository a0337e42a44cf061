"""Time a joint path with one-dimensional ruckig along its parameter, and verify what will be sent.

Timing along the path (`timing.py`) keeps the motion on the path that was checked for collisions.
"""

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.errors import LimitViolation, Refused
from evg_app.motion.path import JointPath
from evg_app.motion.timing import Timing, fastest
from evg_app.motion.verify import limits, position_limits, verify
from evg_app.types import Trajectory

__all__ = ["DT", "limits", "position_limits", "time_path", "verify"]

DT = 0.004
"""Sample interval of every trajectory [s]."""
TRIES = 12
"""Slower timings that are tried until the verifier finds nothing."""
MIN_LENGTH = 1e-9
"""A path shorter than this is a stand-still [rad]."""


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
    scale, speed = share, 1.0
    v, a, j = limits(robot)
    for _ in range(TRIES):
        trajectory = _sample(path, fastest(path, (scale * speed * v, scale * a, scale * j)), robot)
        try:
            return _checked(trajectory, robot)
        except LimitViolation as violation:
            if violation.quantity == "position":
                raise
            if violation.quantity == "velocity" and robot.limits.near_ends is not None:
                speed *= min(0.95, max(0.5, 0.98 * violation.limit / abs(violation.value)))
            else:
                scale *= 0.85
    raise Refused("no timing of this path keeps velocity, acceleration and jerk limits; check limits in the config")


def _sample(path: JointPath, timing: Timing, robot: RobotConfig) -> Trajectory:
    """Samples along a path, `DT` apart."""
    s, ds, dds = timing.sample(DT)
    s[-1], ds[-1], dds[-1] = path.length, 0.0, 0.0
    s = np.clip(s, 0.0, path.length)
    q, d1, d2 = (path.at(s, n) for n in (0, 1, 2))
    q[0], q[-1] = path.waypoints[0], path.waypoints[-1]
    dq = d1 * ds[:, None]
    ddq = d2 * (ds**2)[:, None] + d1 * dds[:, None]
    return Trajectory(tuple(robot.joints), DT, q, dq, ddq)


def _checked(trajectory: Trajectory, robot: RobotConfig) -> Trajectory:
    """A verified trajectory, made read-only."""
    verify(trajectory, robot)
    for array in (trajectory.q, trajectory.dq, trajectory.ddq):
        array.setflags(write=False)
    return trajectory
