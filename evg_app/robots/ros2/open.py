"""The factory: from a robot config to an arm and a gripper that share one ROS 2 node."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from evg_app.clock import Clock, WallClock
from evg_app.config.models import RobotConfig
from evg_app.errors import BadInput
from evg_app.robots.ros2.arm import Ros2Arm
from evg_app.robots.ros2.gripper import Ros2Gripper
from evg_app.robots.ros2.interfaces import interface
from evg_app.robots.ros2.link import Link


@dataclass(frozen=True)
class Ros2Robot:
    """Arm and gripper, not yet entered. Enter each (in any order) and leave each.

    Attributes:
        clock: what their stamps are on.
        link: the node they share.
    """

    arm: Ros2Arm
    gripper: Ros2Gripper
    clock: Clock
    link: Link
    stop_topic: str

    @contextlib.contextmanager
    def listening_for_stop(self, stop: Callable[[], None]) -> Iterator[None]:
        """While inside, any std_msgs/Empty on the config's `stop_topic` calls `stop` (on the ROS thread)."""
        kind = interface("std_msgs.msg", "Empty")
        self.link.acquire()
        try:
            subscription = self.link.call(
                lambda: self.link.node.create_subscription(kind, self.stop_topic, lambda _: stop(), 10),
                f"listening to {self.stop_topic}",
            )
            try:
                yield
            finally:
                if self.link.alive:
                    self.link.call(lambda: self.link.node.destroy_subscription(subscription), "leaving the stop topic")
        finally:
            self.link.release()


def open_robot(robot: RobotConfig, clock: Clock | None = None, use_topic: bool = False) -> Ros2Robot:
    """Arm and gripper of `robot` over ROS 2.

    Enter `.arm` and `.gripper`, and hand them and `.clock` to the loop. `use_topic` sends trajectories to
    the controller's topic even where control_msgs is there.

    Raises:
        BadInput: the robot config has no `ros2` section.
    """
    if robot.ros2 is None:
        raise BadInput(f"robot '{robot.name}' has no 'ros2' section; see robot_configs/panda.yaml and docs/ros2.md")
    clock = clock if clock is not None else WallClock()
    link = Link("evg_app", clock)
    arm = Ros2Arm(robot, robot.ros2, link, use_topic)
    gripper = Ros2Gripper(robot.gripper, robot.ros2, link)
    return Ros2Robot(arm, gripper, clock, link, robot.ros2.stop_topic)
