"""A time budget that a jumping or frozen clock can neither cut short nor stretch."""

from evg_app.clock import Clock


class Budget:
    """Counts the time of a wait in slices. A step that no slice can explain counts as one slice."""

    def __init__(self, clock: Clock, timeout: float, slice_s: float) -> None:
        self._clock, self._timeout, self._slice = clock, timeout, slice_s
        self._last = clock.now()
        self.elapsed = 0.0
        """Time spent so far [s]."""

    def spend(self) -> bool:
        """Count the slice that just passed; whether time is left."""
        now = self._clock.now()
        step, self._last = now - self._last, now
        plausible = 0.0 < step <= 20.0 * self._slice
        self.elapsed += step if plausible else self._slice
        return self.elapsed < self._timeout


def measured(clock: Clock, start: float, limit: float) -> float:
    """Seconds since `start` on the clock, 0 when it went backwards and at most `limit` [s]."""
    return min(max(clock.now() - start, 0.0), limit)
