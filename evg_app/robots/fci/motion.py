"""A motion under way over the Franka Control Interface."""

from typing import Protocol

from evg_app.robots.fci.messages import Ended
from evg_app.types import MotionResult

GOAL_TOLERANCE = 0.01
"""The goal counts as reached within this [rad]."""


class Mover(Protocol):
    """The arm, as its motion needs it."""

    def wait(self, motion: "FciMotion", timeout: float) -> MotionResult | None:
        """Wait for a motion at most `timeout` [s]."""

    def cancel(self, motion: "FciMotion") -> None:
        """Stop a motion."""


class FciMotion:
    """A motion under way."""

    def __init__(self, arm: Mover, number: int) -> None:
        self._arm, self.number = arm, number
        self.result: MotionResult | None = None
        """How it ended, None while it moves."""
        self.ended: Ended | None = None
        """More about its end: lost states, cycles."""

    def wait(self, timeout: float) -> MotionResult | None:
        """Wait at most `timeout` [s]; the result once the motion has ended.

        Raises:
            HardwareError: the connection is lost.
        """
        return self.result if self.result is not None else self._arm.wait(self, timeout)

    def cancel(self) -> None:
        """Brake on the path; the controller then holds the arm."""
        if self.result is None:
            self._arm.cancel(self)

    def finish(self, ended: Ended) -> None:
        """Settle the result."""
        reached = not ended.stopped and not ended.failed and ended.goal_error < GOAL_TOLERANCE
        reason = ended.reason or ("reached" if reached else f"not at the goal: {ended.goal_error:.3f} rad away")
        self.ended = ended
        self.result = MotionResult(reached, reason, ended.goal_error)
