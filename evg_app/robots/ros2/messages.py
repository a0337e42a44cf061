"""Our values as ROS messages."""

from typing import Any

import numpy as np

from evg_app.geometry import Array
from evg_app.robots.ros2.interfaces import interface
from evg_app.types import Trajectory


def duration(value: float) -> Any:
    """A builtin_interfaces/Duration of `value` [s]."""
    nanoseconds = round(value * 1e9)
    return interface("builtin_interfaces.msg", "Duration")(
        sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000
    )


def joint_trajectory(names: tuple[str, ...], trajectory: Trajectory) -> Any:
    """A trajectory_msgs/JointTrajectory that starts when it arrives: exactly the samples that were verified."""
    message = interface("trajectory_msgs.msg", "JointTrajectory")(joint_names=list(names))
    point = interface("trajectory_msgs.msg", "JointTrajectoryPoint")
    message.points = [
        point(
            positions=q.tolist(),
            velocities=dq.tolist(),
            accelerations=ddq.tolist(),
            time_from_start=duration(k * trajectory.dt),
        )
        for k, (q, dq, ddq) in enumerate(zip(trajectory.q, trajectory.dq, trajectory.ddq, strict=True))
    ]
    return message


def braking(names: tuple[str, ...], q: Array, dq: Array, acceleration: Array) -> Any:
    """A trajectory_msgs/JointTrajectory of one point: rest, as soon as `acceleration` [rad/s^2] allows."""
    seconds = max(0.1, float((np.abs(dq) / acceleration).max()))
    rest = q + 0.5 * seconds * dq
    return joint_trajectory_of_one(names, rest, seconds)


def joint_trajectory_of_one(names: tuple[str, ...], q: Array, seconds: float) -> Any:
    """A trajectory with one point at rest at `q` [rad], `seconds` [s] from now."""
    point = interface("trajectory_msgs.msg", "JointTrajectoryPoint")(
        positions=q.tolist(), velocities=[0.0] * len(q), time_from_start=duration(seconds)
    )
    return interface("trajectory_msgs.msg", "JointTrajectory")(joint_names=list(names), points=[point])
