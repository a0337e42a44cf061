"""Recovery after a reflex: three ordered steps, each with a name, and then proof that the arm is well."""

from typing import Any

from evg_app.config.ros2 import Ros2Model, Ros2Recovery
from evg_app.errors import DeviceTimeout, HardwareError
from evg_app.robots.ros2.goal import SUCCEEDED, Goal
from evg_app.robots.ros2.interfaces import interface
from evg_app.robots.ros2.link import Link
from evg_app.robots.ros2.service import Service

ACTIVE_ID, ACTIVE = 3, "active"
"""PRIMARY_STATE_ACTIVE of lifecycle_msgs/State."""
BEST_EFFORT = 1
"""Strictness of SwitchController: a controller that is active already is no error."""


class Recovery:
    """Runs the steps that the config names, in their order."""

    def __init__(self, link: Link, config: Ros2Model, steps: Ros2Recovery) -> None:
        self._link, self._config, self._steps = link, config, steps
        self._client: Any = None

    def open(self) -> None:
        """Create the clients, so that the servers are known by the time they are needed."""
        if self._steps.error_recovery_action:
            from rclpy.action import ActionClient

            kind, name = interface("franka_msgs.action", "ErrorRecovery"), self._steps.error_recovery_action
            self._client = self._link.call(lambda: ActionClient(self._link.node, kind, name), f"a client of {name}")

    def close(self) -> None:
        """Destroy the clients."""
        client, self._client = self._client, None
        if client is not None and self._link.alive:
            self._link.call(client.destroy, "leaving the error recovery")

    def run(self, timeout: float) -> None:
        """All steps within `timeout` [s].

        Raises:
            HardwareError: a step failed; named.
            DeviceTimeout: a step took too long; named.
        """
        end = self._link.clock.now() + timeout
        for number, (name, step) in enumerate(self._plan(), 1):
            left = end - self._link.clock.now()
            if left <= 0:
                raise DeviceTimeout(f"recovery step {number} ({name})", timeout, "Look at the robot's own web page.")
            try:
                step(left)
            except HardwareError as error:
                raise type(error)(*_again(error, number, name)) from error

    def _plan(self) -> list[tuple[str, Any]]:
        """The configured steps in their order, by name."""
        plan: list[tuple[str, Any]] = []
        if self._steps.error_recovery_action:
            plan.append((self._steps.error_recovery_action, self._clear_error))
        if self._steps.hardware_service:
            plan.append((self._steps.hardware_service, self._activate_hardware))
        if self._steps.switch_service and self._steps.controllers:
            plan.append((self._steps.switch_service, self._activate_controllers))
        return plan

    def _clear_error(self, timeout: float) -> None:
        """Step 1: the robot's own error recovery."""
        name = self._steps.error_recovery_action
        goal = Goal(self._link, self._client, name)
        goal.send(interface("franka_msgs.action", "ErrorRecovery").Goal(), timeout, f"Run: {self._config.start_arm}")
        self._link.wait(goal.ended, timeout, f"{name} to end", "Is the user stop pressed?")
        if goal.status != SUCCEEDED:
            raise HardwareError(f"{name} did not clear the error. Unlock the robot on its web page (Desk)")

    def _activate_hardware(self, timeout: float) -> None:
        """Step 2: the hardware component becomes active."""
        kind = interface("controller_manager_msgs.srv", "SetHardwareComponentState")
        request = kind.Request(name=self._steps.hardware_component)
        request.target_state.id, request.target_state.label = ACTIVE_ID, ACTIVE
        answer = Service(self._link, kind, self._steps.hardware_service).call(
            request, timeout, f"Run: {self._config.start_arm}"
        )
        if not answer.ok:
            raise HardwareError(
                f"'{self._steps.hardware_component}' did not become active, it is '{answer.state.label}'. "
                f"Run: ros2 control set_hardware_component_state {self._steps.hardware_component} active"
            )

    def _activate_controllers(self, timeout: float) -> None:
        """Step 3: the controllers become active."""
        kind = interface("controller_manager_msgs.srv", "SwitchController")
        request = kind.Request(activate_controllers=list(self._steps.controllers), strictness=BEST_EFFORT)
        request.activate_asap = True
        request.timeout.sec = max(1, int(timeout))
        answer = Service(self._link, kind, self._steps.switch_service).call(
            request, timeout, f"Run: {self._config.start_arm}"
        )
        if not answer.ok:
            names = " ".join(self._steps.controllers)
            why = getattr(answer, "message", "") or "no reason given"
            raise HardwareError(
                f"controllers were not activated: {why}. Run: ros2 control switch_controllers --activate {names}"
            )


def _again(error: HardwareError, number: int, name: str) -> tuple[Any, ...]:
    """Arguments for the same error that also says which step it was."""
    if isinstance(error, DeviceTimeout):
        return f"recovery step {number}, {error.wait}", error.timeout, str(error).partition(". ")[2]
    return (f"recovery step {number} ({name}): {error}",)
