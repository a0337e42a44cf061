"""What the tests on the wire share."""

import numpy as np

from evg_app.config.files import load_robot
from evg_app.config.models import RobotConfig
from evg_app.robots.ros2 import Ros2Robot
from evg_app.types import MotionResult, Trajectory

TURN = np.array([0.3, -0.2, 0.2, 0.2, 0.2, -0.2, 0.4])
"""A free motion from the look pose [rad]."""


def configured(**changes: object) -> RobotConfig:
    """The panda with other values in its `ros2` section."""
    robot = load_robot("panda")
    assert robot.ros2 is not None
    return robot.model_copy(update={"ros2": robot.ros2.model_copy(update=changes)})


def motion(robot: Ros2Robot, turn: np.ndarray = TURN, duration: float = 1.5, dt: float = 0.01) -> Trajectory:
    """A smooth motion from where the arm is."""
    n = round(duration / dt)
    s = np.arange(n + 1)[:, None] / n
    q = robot.arm.state().q + (10 * s**3 - 15 * s**4 + 6 * s**5) * turn
    dq = (30 * s**2 - 60 * s**3 + 30 * s**4) / duration * turn
    return Trajectory(robot.arm.joint_names, dt, q, dq, (60 * s - 180 * s**2 + 120 * s**3) / duration**2 * turn)


def end_of(handle, seconds: float = 10.0) -> MotionResult:
    for _ in range(round(seconds / 0.02)):
        result = handle.wait(0.02)
        if result is not None:
            return result
    raise AssertionError("the motion never ended")
