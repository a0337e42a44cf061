"""A motion under way, as a FollowJointTrajectory goal or on the controller's topic."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from evg_app.clock import Clock
from evg_app.config.ros2 import Ros2Model
from evg_app.errors import DeviceTimeout, HardwareError
from evg_app.geometry import Array
from evg_app.robots.ros2.goal import CANCELED, SUCCEEDED, Goal
from evg_app.types import ArmState, MotionResult, Trajectory

LOOK_S = 0.01
"""How often a wait looks at the arm [s]."""
CODES = {
    -1: "INVALID_GOAL",
    -2: "INVALID_JOINTS",
    -3: "OLD_HEADER_TIMESTAMP",
    -4: "PATH_TOLERANCE_VIOLATED",
    -5: "GOAL_TOLERANCE_VIOLATED",
}
"""error_code of control_msgs/FollowJointTrajectory."""


class Carrier(Protocol):
    """How a motion is told to the controller and heard of again."""

    def ended(self) -> tuple[bool, str] | None:
        """Whether it succeeded and in what words, once the controller is done; None before.

        Raises:
            HardwareError: the controller went silent.
        """

    def cancel(self) -> bool:
        """Ask the controller to stop; whether it confirmed."""


class ActionCarrier:
    """A goal of the FollowJointTrajectory action."""

    def __init__(self, goal: Goal, config: Ros2Model, clock: Clock) -> None:
        self._goal, self._config, self._clock = goal, config, clock

    def ended(self) -> tuple[bool, str] | None:
        """The action's result, in words."""
        goal = self._goal
        if goal.ended.is_set():
            if goal.status == CANCELED:
                return False, "cancelled"
            code = getattr(goal.result, "error_code", 0)
            if goal.status == SUCCEEDED and code == 0:
                return True, "reached"
            words = getattr(goal.result, "error_string", "") or "no reason given"
            return False, f"{CODES.get(code, f'aborted (code {code})')}: {words}"
        silence = self._clock.now() - goal.heard
        if silence > self._config.feedback_timeout_s:
            raise DeviceTimeout(
                f"feedback of {self._config.arm_action} (silent for {silence:.1f} s)",
                self._config.feedback_timeout_s,
                f"The controller may have died. Look: ros2 control list_controllers; start: {self._config.start_arm}",
            )
        return None

    def cancel(self) -> bool:
        """Cancel the goal; the controller then holds its position."""
        return self._goal.cancel(self._config.cancel_timeout_s)


class TopicCarrier:
    """A trajectory on the controller's topic: nobody accepts, feeds back or reports; only the joints tell."""

    def __init__(
        self, brake: Callable[[], None], look: Callable[[], ArmState], trajectory: Trajectory, clock: Clock
    ) -> None:
        self._brake, self._look, self._clock = brake, look, clock
        self._goal = trajectory.q[-1]
        self._due = clock.now() + trajectory.duration
        self._cancelled = False

    def ended(self) -> tuple[bool, str] | None:
        """Judged by time and joint positions."""
        if self._cancelled:
            return False, "cancelled"
        if self._clock.now() < self._due:
            return None
        gap = float(np.abs(self._look().q - self._goal).max())
        if gap < GOAL_RAD:
            return True, "reached"
        late = self._clock.now() - self._due
        return (False, f"not at the goal: {gap:.3f} rad away (allowed {GOAL_RAD})") if late > SETTLE_S else None

    def cancel(self) -> bool:
        """Send a short braking trajectory; nothing confirms it."""
        if not self._cancelled:
            self._cancelled = True
            self._brake()
        return True


GOAL_RAD, SETTLE_S = 0.01, 1.0
"""On the topic the goal counts as reached within this [rad], at most this long after the trajectory's end [s]."""


class Ros2Motion:
    """Implements `robots.protocol.MotionHandle`.

    Attributes:
        lost: contact was lost while it moved; the arm takes no motion before `recover`.
    """

    def __init__(
        self,
        carrier: Carrier,
        trajectory: Trajectory,
        config: Ros2Model,
        clock: Clock,
        look: Callable[[], ArmState],
        done: Callable[["Ros2Motion"], None],
    ) -> None:
        self._carrier, self._config, self._clock, self._look, self._done = carrier, config, clock, look, done
        self._goal: Array = trajectory.q[-1]
        self._result: MotionResult | None = None
        self._settling: tuple[bool, str, float] | None = None
        self.lost = False

    def wait(self, timeout: float) -> MotionResult | None:
        """Wait at most `timeout` [s]; the result once the controller is done and a later state shows rest.

        Raises:
            DeviceTimeout: joint states or feedback stopped coming; the motion was cancelled as far as anybody listens.
        """
        end = self._clock.now() + timeout
        while self._result is None:
            try:
                self._step()
            except HardwareError:
                self._lose()
                raise
            left = end - self._clock.now()
            if self._result is not None or left <= 0:
                break
            self._clock.sleep(min(LOOK_S, left))
        return self._result

    def _step(self) -> None:
        """One look: has it ended, and does the arm rest?"""
        state = self._look()
        if self._settling is None:
            ended = self._carrier.ended()
            if ended is None:
                return
            self._settling = (*ended, self._clock.now())
        reached, reason, since = self._settling
        until = since + self._config.settle_s
        rests = state.stamp >= since and float(np.abs(state.dq).max(initial=0.0)) < self._config.rest_rad_s
        if rests or self._clock.now() >= until:
            gap = float(np.abs(state.q - self._goal).max(initial=0.0))
            self.end(MotionResult(reached, reason, gap))

    def _lose(self) -> None:
        """Contact is lost: cancel as far as anybody listens."""
        self.lost = True
        self.cancel()

    def end(self, result: MotionResult) -> None:
        """Settle the result and free the arm."""
        self._result = result
        self._done(self)

    def abandon(self) -> None:
        """Forget a lost motion, after recovery."""
        if self._result is None:
            self.end(MotionResult(False, "contact was lost", float("inf")))

    def cancel(self) -> None:
        """Stop this motion; the cancel reaches the wire before this returns, unless nobody listens any more."""
        if self._result is None:
            self._carrier.cancel()


__all__ = ["ActionCarrier", "Carrier", "Ros2Motion", "TopicCarrier"]
