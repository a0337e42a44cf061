"""Time is injected: hardware runs on the wall clock, the simulator on its own."""

import time
from typing import Protocol


class Clock(Protocol):
    """What every wait uses."""

    def now(self) -> float:
        """Monotonic time [s]."""

    def sleep(self, seconds: float) -> None:
        """Let `seconds` pass; a simulated clock steps its world."""


class WallClock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        """Monotonic time [s]."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Block for `seconds`."""
        time.sleep(max(seconds, 0.0))
