"""The gripper over ROS 2: franka_msgs actions, or control_msgs/GripperCommand."""

from functools import partial
from typing import Any

import numpy as np

from evg_app.config.models import GripperModel
from evg_app.config.ros2 import Ros2Model
from evg_app.errors import DeviceTimeout, HardwareError
from evg_app.robots.ros2.device import Ros2Device
from evg_app.robots.ros2.feeds import Feed, Joints
from evg_app.robots.ros2.goal import SUCCEEDED, Goal
from evg_app.robots.ros2.interfaces import interface
from evg_app.robots.ros2.link import Link
from evg_app.robots.ros2.service import Service
from evg_app.types import GripperResult, GripperState

STOP_TIMEOUT = 1.0
"""How long a stop may take to be confirmed [s]."""
HELD_DRIFT_M = 0.002
"""An object counts as held by the device while the opening stays this close to where the grasp ended [m]."""
FRESH_S = 1.0
"""After a command the next joint state is awaited this long [s]: franka_gripper publishes at 15 Hz."""


class Ros2Gripper(Ros2Device):
    """Implements `robots.protocol.Gripper`.

    franka_gripper has no flag for "something is held": `is_grasped` is the verdict of the last grasp, as long as the
    opening has not moved since.
    """

    def __init__(self, model: GripperModel, config: Ros2Model, link: Link) -> None:
        super().__init__(config, link)
        self._model = model
        self._names = config.gripper
        joints = Joints(self._names.finger_joints)
        advice = f"Run: {config.start_gripper}   and look with: ros2 topic hz {self._names.joint_states}"
        self._joints = joints
        self._feed = Feed(
            link.clock, self._names.joint_states, self._names.state_timeout_s, advice, self._names.finger_joints
        )
        self._clients: dict[str, Any] = {}
        self._goal: Goal | None = None
        self._held_at: float | None = None

    @property
    def identity(self) -> dict[str, str]:
        """The kind of hand and what its actions are called."""
        return {"driver": "ros2", "kind": self._names.kind, "actions": ", ".join(self._actions())}

    def _actions(self) -> dict[str, tuple[str, str]]:
        """Kind (module, class) of every action, by its name on the wire."""
        names = self._names
        if names.kind == "gripper_command":
            return {names.command_action: ("control_msgs.action", "GripperCommand")}
        return {
            names.homing_action: ("franka_msgs.action", "Homing"),
            names.move_action: ("franka_msgs.action", "Move"),
            names.grasp_action: ("franka_msgs.action", "Grasp"),
        }

    def _open(self) -> None:
        """Subscribe to the fingers and make a client of every action."""
        from rclpy.action import ActionClient

        self._feed.subscribe(self._link, interface("sensor_msgs.msg", "JointState"))
        for action, (module, name) in self._actions().items():
            make = partial(ActionClient, self._link.node, interface(module, name), action)
            self._clients[action] = self._link.call(make, f"a client of {action}")

    def _missing(self) -> list[str]:
        """Actions and topics that are not there."""
        missing = [action for action, client in self._clients.items() if not client.server_is_ready()]
        return missing + ([] if self._feed.fresh else [self._feed.topic])

    def _not_found(self, missing: list[str]) -> str:
        """What to say about who is missing."""
        return (
            f"not there after {self._config.server_timeout_s:g} s: {', '.join(missing)}. franka_ros2's fake hardware "
            f"has no gripper actions. Run: {self._config.start_gripper}   or look: evg-app ros check"
        )

    def _served(self) -> list[str]:
        """One action of the hand stands for all."""
        return list(self._clients)[:1]

    def _halt(self) -> None:
        """Cancel a command under way; the fingers stay as they are."""
        if self._goal is not None:
            self._goal.cancel(STOP_TIMEOUT)

    def _close(self) -> None:
        """Give subscription and clients back."""
        self._feed.unsubscribe(self._link)
        clients, self._clients = self._clients, {}
        for client in clients.values():
            self._link.call(client.destroy, "leaving the gripper")

    def state(self) -> GripperState:
        """The latest stamped state.

        Raises:
            DeviceTimeout: it is stale.
        """
        self._link.check()
        message, stamp = self._feed.latest()
        width = float(np.sum(self._joints.read(message)[0])) * self._names.width_per_position
        held = self._held_at is not None and abs(width - self._held_at) < HELD_DRIFT_M
        return GripperState(stamp, width, held)

    def homing(self, timeout: float) -> GripperResult:
        """Find the opening limits; GripperCommand has no such thing and opens."""
        if self._names.kind == "gripper_command":
            return self.move(self._model.max_width_m, self._model.speed_m_s, timeout)
        kind = interface("franka_msgs.action", "Homing")
        return self._franka(self._names.homing_action, kind.Goal(), timeout)

    def move(self, width: float, speed: float, timeout: float) -> GripperResult:
        """Open or close to `width` [m] at `speed` [m/s]; GripperCommand ignores the speed."""
        width = float(np.clip(width, 0.0, self._model.max_width_m))
        if self._names.kind == "gripper_command":
            return self._command(width, 0.0, timeout, lambda final, stalled: abs(final - width) < HELD_DRIFT_M)
        kind = interface("franka_msgs.action", "Move")
        return self._franka(self._names.move_action, kind.Goal(width=width, speed=float(speed)), timeout)

    def grasp(
        self, width: float, speed: float, force: float, epsilon_inner: float, epsilon_outer: float, timeout: float
    ) -> GripperResult:
        """Close with `force` [N]; success iff width - epsilon_inner < final width < width + epsilon_outer [m]."""
        if self._names.kind == "gripper_command":
            result = self._command(
                0.0, float(force), timeout, lambda final, _: width - epsilon_inner < final < width + epsilon_outer
            )
        else:
            request = interface("franka_msgs.action", "Grasp").Goal(
                width=float(width), speed=float(speed), force=float(force)
            )
            request.epsilon.inner, request.epsilon.outer = float(epsilon_inner), float(epsilon_outer)
            result = self._franka(self._names.grasp_action, request, timeout)
        self._held_at = result.width if result.success and result.width > HELD_DRIFT_M else None
        return result

    def stop(self) -> None:
        """Cancel the command under way and stop the fingers where they are.

        Raises:
            HardwareError: the stop did not reach the gripper.
        """
        self._held_at = None
        goal, self._goal = self._goal, None
        confirmed = goal is None or goal.cancel(STOP_TIMEOUT)
        if self._names.kind == "franka":
            advice = f"Run: ros2 service call {self._names.stop_service} std_srvs/srv/Trigger"
            kind = interface("std_srvs.srv", "Trigger")
            Service(self._link, kind, self._names.stop_service).call(kind.Request(), STOP_TIMEOUT, advice)
        elif not confirmed:
            raise HardwareError(f"{self._names.command_action} did not confirm the stop. Press the robot's stop button")

    def _franka(self, action: str, request: Any, timeout: float) -> GripperResult:
        """Run an action of franka_msgs, and read the fingers after it."""
        goal = self._run(action, request, timeout)
        result = goal.result
        success = goal.status == SUCCEEDED and bool(getattr(result, "success", False))
        return GripperResult(success, self._width_after(goal), str(getattr(result, "error", "")))

    def _command(self, width: float, effort: float, timeout: float, good: Any) -> GripperResult:
        """Run a GripperCommand to `width` [m]; `good` judges final width and stall."""
        kind = interface("control_msgs.action", "GripperCommand")
        request = kind.Goal()
        request.command.position = width * self._names.position_per_width
        request.command.max_effort = effort
        goal = self._run(self._names.command_action, request, timeout)
        final = self._width_after(goal)
        stalled = bool(getattr(goal.result, "stalled", False))
        return GripperResult(bool(good(final, stalled)), final, "stalled" if stalled else "")

    def _run(self, action: str, request: Any, timeout: float) -> Goal:
        """Send a goal and wait for its end; on a timeout or a stop it is cancelled."""
        self._link.check()
        self._held_at = None
        advice = f"Run: {self._config.start_gripper}"
        self._goal = goal = Goal(self._link, self._clients[action], action)
        try:
            goal.send(request, self._config.accept_timeout_s, advice)
            self._link.wait(goal.ended, timeout, f"{action} to end", f"It was cancelled. {advice}")
        except DeviceTimeout:
            goal.cancel(STOP_TIMEOUT)
            raise
        self._goal = None
        return goal

    def _width_after(self, goal: Goal) -> float:
        """The opening in a state that was made after the command ended [m]."""
        self._link.wait_until(lambda: self._link.clock.now() - self._feed.age > goal.heard, FRESH_S)
        return self.state().width
