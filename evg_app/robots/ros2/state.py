"""The arm's state, put together from joint states, the Franka robot state and a force topic."""

from typing import Any

import numpy as np

from evg_app.clock import Clock
from evg_app.config.ros2 import Ros2Model
from evg_app.geometry import Array
from evg_app.robots.ros2.feeds import Feed, Joints
from evg_app.robots.ros2.interfaces import interface
from evg_app.robots.ros2.link import Link
from evg_app.types import ArmMode, ArmState

MODES = {
    0: ArmMode.OTHER,
    3: ArmMode.GUIDING,
    4: ArmMode.REFLEX,
    5: ArmMode.USER_STOPPED,
    6: ArmMode.OTHER,
}
"""robot_mode of franka_msgs/FrankaRobotState. IDLE and MOVE are left out: a controller that holds is in MOVE, too."""
IDLE = 1
"""robot_mode when no controller runs."""


class StateReader:
    """Subscribes to what the robot config names and answers with an `ArmState`.

    Args:
        names: the joints on the wire, in the order of the answer.
    """

    def __init__(self, clock: Clock, config: Ros2Model, names: tuple[str, ...]) -> None:
        self._config, self._joints = config, Joints(names)
        advice = f"Run: {config.start_arm}   and look with: ros2 topic hz "
        limit = config.state_timeout_s
        self.joints = Feed(clock, config.joint_states, limit, advice + config.joint_states, names)
        self.robot = Feed(clock, config.robot_state, limit, advice + config.robot_state)
        self.wrench = Feed(clock, config.wrench, limit, advice + config.wrench)

    def feeds(self) -> list[Feed]:
        """Those that the config names."""
        return [feed for feed in (self.joints, self.robot, self.wrench) if feed.topic]

    def subscribe(self, link: Link) -> None:
        """Start listening."""
        kinds = {
            id(self.joints): ("sensor_msgs.msg", "JointState"),
            id(self.robot): ("franka_msgs.msg", "FrankaRobotState"),
            id(self.wrench): ("geometry_msgs.msg", "WrenchStamped"),
        }
        for feed in self.feeds():
            feed.subscribe(link, interface(*kinds[id(feed)]))

    def unsubscribe(self, link: Link) -> None:
        """Stop listening."""
        for feed in self.feeds():
            feed.unsubscribe(link)

    def healthy(self) -> bool:
        """Whether every topic is fresh and the robot reports neither an error nor a stop."""
        if not all(feed.fresh for feed in self.feeds()):
            return False
        mode, errors = self._condition(moving=False)
        return mode is ArmMode.IDLE and not errors

    def uncontrolled(self) -> bool:
        """Whether the robot says that no controller runs (franka robot_mode IDLE; one that holds is in MOVE)."""
        return bool(self.robot.topic) and self.robot.fresh and int(self.robot.latest()[0].robot_mode) == IDLE

    def read(self, moving: bool) -> ArmState:
        """The latest state, stamped as its oldest part; `moving` is whether we have a motion under way.

        Raises:
            DeviceTimeout: a topic is stale; named.
        """
        message, stamp = self.joints.latest()
        q, dq = self._joints.read(message)
        mode, errors = self._condition(moving)
        if self.robot.topic:
            stamp = min(stamp, self.robot.latest()[1])
        return ArmState(stamp, q, dq, mode, errors, self._wrench())

    def _condition(self, moving: bool) -> tuple[ArmMode, tuple[str, ...]]:
        """Mode and active errors as the robot states them."""
        mode = ArmMode.MOVING if moving else ArmMode.IDLE
        if not self.robot.topic:
            return mode, ()
        state = self.robot.latest()[0]
        fields = type(state.current_errors).get_fields_and_field_types()
        errors = tuple(name for name in fields if getattr(state.current_errors, name))
        return MODES.get(int(state.robot_mode), mode), errors

    def _wrench(self) -> Array:
        """Force [N] and torque [Nm] in the base frame; zeros when the robot publishes none. Shape (6,)."""
        if self.wrench.topic:
            return six(self.wrench.latest()[0].wrench)
        if self.robot.topic:
            return six(self.robot.latest()[0].o_f_ext_hat_k.wrench)
        return np.zeros(6)


def six(wrench: Any) -> Array:
    """Force [N], then torque [Nm], of a geometry_msgs/Wrench. Shape (6,)."""
    f, t = wrench.force, wrench.torque
    return np.array([f.x, f.y, f.z, t.x, t.y, t.z], dtype=np.float64)
