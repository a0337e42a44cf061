"""The arm over ROS 2: trajectories through a joint_trajectory_controller, state from what the robot publishes."""

import contextlib
from typing import Any

import numpy as np

from evg_app.clock import Clock
from evg_app.config.models import RobotConfig
from evg_app.config.ros2 import Ros2Model
from evg_app.errors import DeviceTimeout, HardwareError, Refused
from evg_app.geometry import Array
from evg_app.identity import installed
from evg_app.robots.ros2.device import Ros2Device
from evg_app.robots.ros2.goal import Goal
from evg_app.robots.ros2.interfaces import interface, is_there
from evg_app.robots.ros2.link import Link
from evg_app.robots.ros2.messages import braking, duration, joint_trajectory
from evg_app.robots.ros2.motion import ActionCarrier, Carrier, Ros2Motion, TopicCarrier
from evg_app.robots.ros2.network import network
from evg_app.robots.ros2.recovery import Recovery
from evg_app.robots.ros2.rivals import require_one, servers, too_many
from evg_app.robots.ros2.state import StateReader
from evg_app.types import ArmMode, ArmState, Trajectory

LOST_WITHOUT_CONTROL_MSGS = (
    "control_msgs is not there, so trajectories go to {topic}: nobody accepts or rejects them, no reason is given when "
    "the controller gives up, and a stop is not confirmed. Run: evg-app ros build"
)
NODES_S = 5.0
"""The names of other nodes come after what they serve; a message waits this long for one of them [s]."""


class Ros2Arm(Ros2Device):
    """Implements `robots.protocol.Arm`.

    Args:
        robot: its `ros2` section names everything on the wire.
        link: shared with the gripper.
        use_topic: use the controller's topic even where control_msgs is there.
    """

    def __init__(self, robot: RobotConfig, config: Ros2Model, link: Link, use_topic: bool = False) -> None:
        super().__init__(config, link)
        self._robot, self._use_topic = robot, use_topic
        self._names = config.joints or robot.joints
        self._reader = StateReader(link.clock, config, self._names)
        self._recovery = None if config.recovery is None else Recovery(link, config, config.recovery)
        self._client: Any = None
        self._publisher: Any = None
        self._motion: Ros2Motion | None = None
        self.warnings: tuple[str, ...] = ()
        """What a person should know about this connection; filled on entry."""

    @property
    def identity(self) -> dict[str, str]:
        """Middleware, domain and the nodes in sight; the serial number is the config's."""
        nodes = ", ".join(self._other_nodes()) if self._link.alive else ""
        told = {"driver": "ros2", "serial": self._robot.serial, "action": self._config.arm_action}
        return told | {"rclpy": installed("ros-jazzy-rclpy"), "network": str(network()), "nodes": nodes}

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the J joints, as the robot config has them."""
        return self._robot.joints

    @property
    def _clock(self) -> Clock:
        """Of all stamps and waits."""
        return self._link.clock

    def _open(self) -> None:
        """Subscribe to the state; make the recovery's clients and the way for trajectories."""
        setting = network()
        self.warnings = (str(setting), *setting.notes)
        self._reader.subscribe(self._link)
        if self._recovery is not None:
            self._recovery.open()
        node, config = self._link.node, self._config
        if self._use_topic or not is_there("control_msgs"):
            kind = interface("trajectory_msgs.msg", "JointTrajectory")
            what = f"a publisher of {config.arm_topic}"
            self._publisher = self._link.call(lambda: node.create_publisher(kind, config.arm_topic, 1), what)
            self.warnings += (LOST_WITHOUT_CONTROL_MSGS.format(topic=config.arm_topic),)
            return
        from rclpy.action import ActionClient

        action = interface("control_msgs.action", "FollowJointTrajectory")
        what = f"a client of {config.arm_action}"
        self._client = self._link.call(lambda: ActionClient(node, action, config.arm_action), what)

    def _missing(self) -> list[str]:
        """The controller and the topics that are not there."""
        missing = [] if self._serves() else [self._config.arm_action if self._client else self._config.arm_topic]
        return missing + [feed.topic for feed in self._reader.feeds() if not feed.fresh]

    def _serves(self) -> bool:
        """Whether somebody takes trajectories."""
        if self._client is not None:
            return bool(self._client.server_is_ready())
        return self._publisher is not None and self._publisher.get_subscription_count() > 0

    def _other_nodes(self) -> list[str]:
        """Names of the other nodes in sight."""
        return sorted(set(self._link.node.get_node_names()) - {self._link.node.get_name()})

    def _not_found(self, missing: list[str]) -> str:
        """What to say about who is missing."""
        self._link.wait_until(lambda: bool(self._other_nodes()), NODES_S)
        seen = self._other_nodes()
        others = f"nodes seen: {', '.join(seen)}" if seen else "no other node is seen at all: same domain?"
        return (
            f"not there after {self._config.server_timeout_s:g} s: {', '.join(missing)} ({network()}; {others}). "
            f"Run: {self._config.start_arm}   or look: evg-app ros check"
        )

    def _served(self) -> list[str]:
        """The trajectory action, where it is used."""
        return [] if self._client is None else [self._config.arm_action]

    def _halt(self) -> None:
        """Cancel the motion under way."""
        motion, self._motion = self._motion, None
        if motion is not None:
            motion.cancel()

    def _close(self) -> None:
        """Give subscriptions and clients back."""
        self._reader.unsubscribe(self._link)
        if self._recovery is not None:
            self._recovery.close()
        client, self._client = self._client, None
        publisher, self._publisher = self._publisher, None
        if client is not None:
            self._link.call(client.destroy, "leaving the arm's action")
        if publisher is not None:
            self._link.call(lambda: self._link.node.destroy_publisher(publisher), "leaving the arm's topic")

    def state(self) -> ArmState:
        """The latest stamped state.

        Raises:
            DeviceTimeout: the state is stale; the topic is named.
        """
        self._link.check()
        return self._reader.read(moving=self._motion is not None)

    def execute(self, trajectory: Trajectory) -> Ros2Motion:
        """Send a trajectory and wait until the controller has taken it.

        Raises:
            Refused: it does not start where the arm is, or is for other joints; nothing was sent.
            HardwareError: the arm is not ready, not exactly one controller is there, or it rejected the goal.
            DeviceTimeout: the state is stale, or the controller did not answer; a late goal is cancelled.
        """
        if trajectory.joint_names != self.joint_names:
            raise Refused(f"trajectory for joints {trajectory.joint_names}, the arm has {self.joint_names}")
        state = self.state()
        self._require_ready(state)
        gap = float(np.abs(trajectory.q[0] - state.q).max())
        allowed = self._config.start_tolerance_rad
        if not gap <= allowed:
            raise Refused(f"trajectory starts {gap:.3f} rad from the arm (allowed {allowed}); plan it anew")
        carrier = self._send(trajectory)
        self._motion = Ros2Motion(carrier, trajectory, self._config, self._clock, self.state, self._finished)
        return self._motion

    def _require_ready(self, state: ArmState) -> None:
        """Pass when the arm may take a motion; see `execute` for what it raises."""
        if self._motion is not None and self._motion.lost:
            raise HardwareError("contact to the arm was lost during a motion; recover() first")
        if self._motion is not None:
            raise HardwareError("the arm is still moving; cancel the motion under way and wait for it first")
        if state.errors or state.mode is not ArmMode.IDLE:
            raise HardwareError(
                f"the arm is in mode '{state.mode}', errors: {', '.join(state.errors) or 'none'}; recover() first"
            )

    def _send(self, trajectory: Trajectory) -> Carrier:
        """Hand a trajectory to the controller, over its action or its topic."""
        config = self._config
        message = joint_trajectory(self._names, trajectory)
        if self._client is None:
            self._publish(message)
            return TopicCarrier(self._brake, self.state, trajectory, self._clock)
        require_one(self._link, config.arm_action)
        request = interface("control_msgs.action", "FollowJointTrajectory").Goal(trajectory=message)
        request.goal_time_tolerance = duration(config.settle_s)
        goal = Goal(self._link, self._client, config.arm_action)
        goal.send(request, config.accept_timeout_s, f"Run: {config.start_arm}   or: ros2 control list_controllers")
        return ActionCarrier(goal, config, self._clock)

    def _publish(self, message: Any) -> None:
        """Put a trajectory on the controller's topic."""
        self._link.call(lambda: self._publisher.publish(message), f"a trajectory to leave for {self._config.arm_topic}")

    def _brake(self) -> None:
        """On the topic: replace the trajectory by one that stops."""
        try:
            state = self.state()
        except DeviceTimeout:
            return
        limits: Array = np.asarray(self._robot.limits.acceleration_rad_s2)
        self._publish(braking(self._names, state.q, state.dq, limits * self._robot.limits.acceleration_scale))

    def _finished(self, motion: Ros2Motion) -> None:
        """A motion has ended; the arm is free for the next."""
        if self._motion is motion:
            self._motion = None

    def recover(self, timeout: float) -> None:
        """Stop what moves, run the configured steps when the arm is unwell, and wait until it is idle and at rest.

        Raises:
            HardwareError: a step failed, or a person holds the user stop.
            DeviceTimeout: it is not idle after `timeout` [s].
        """
        end = self._clock.now() + timeout
        if self._motion is not None:
            self._motion.cancel()
        for feed in self._reader.feeds():
            feed.forget()
        well = self._link.wait_until(self._reader.healthy, min(timeout, 2 * self._config.state_timeout_s))
        if not well or self._reader.uncontrolled():
            self._refuse_user_stop()
            if self._recovery is not None:
                self._recovery.run(max(0.1, end - self._clock.now()))
        if not self._link.wait_until(self._idle, max(0.1, end - self._clock.now())):
            raise DeviceTimeout("the arm to be idle and at rest", timeout, self._unwell())
        if self._motion is not None:
            self._motion.abandon()

    def _refuse_user_stop(self) -> None:
        """Raise when a person holds the user stop."""
        with contextlib.suppress(DeviceTimeout):
            if self.state().mode is ArmMode.USER_STOPPED:
                raise HardwareError("the user stop is pressed. Release it; then start the run again")

    def _idle(self) -> bool:
        """Whether the arm is well, served by one controller, and at rest."""
        if not (self._reader.healthy() and self._serves() and self._alone()):
            return False
        return float(np.abs(self._reader.read(moving=False).dq).max(initial=0.0)) < self._config.rest_rad_s

    def _alone(self) -> bool:
        """Whether not more than one controller answers."""
        return self._client is None or servers(self._link, self._config.arm_action) <= 1

    def _unwell(self) -> str:
        """Why the arm is not idle, and what to do."""
        if self._missing():
            return f"Not there: {', '.join(self._missing())}. Run: {self._config.start_arm}"
        if not self._alone():
            return too_many(servers(self._link, self._config.arm_action), self._config.arm_action)
        state = self.state()
        return f"Mode '{state.mode}', errors: {', '.join(state.errors) or 'none'}. Unlock the robot on its web page"
