"""What is streamed at 1 kHz: a verified trajectory as quintic pieces, slowed to a stop on its own path when asked."""

import numpy as np

from evg_app.geometry import Array
from evg_app.quintic import evaluate, quintics

BLEND_S = 0.5
"""Over this long the gap between where the trajectory and where the controller starts is faded out [s]."""
BRAKE_SHARE = 0.5
"""Share of the acceleration and jerk limits that braking may use."""
SHORTEST_BRAKE = 0.05
"""Braking takes at least this long [s]."""


class Profile:
    """A trajectory (q, dq, ddq sampled every `dt`) as a function of time.

    Args:
        q, dq, ddq: samples, shape (M, J) [rad, s].
        dt: sample interval [s].
    """

    def __init__(self, q: Array, dq: Array, ddq: Array, dt: float) -> None:
        self.duration = dt * (len(q) - 1)
        self.goal: Array = q[-1]
        self._dt, self._last = dt, len(q) - 2
        self._coefficients = quintics(q, dq, ddq, dt)
        self._first, self._gap = q[0], np.zeros(q.shape[1])
        self._blend = min(BLEND_S, self.duration)

    def begin_at(self, start: Array) -> None:
        """Start at the controller's set point (J,) [rad]; the gap to the first sample is faded out over `BLEND_S`."""
        self._gap = start - self._first

    def at(self, s: float) -> Array:
        """Set point [rad] at time `s` [s]. Shape (J,)."""
        s = min(max(s, 0.0), self.duration)
        k = min(int(s / self._dt), self._last)
        u = s / self._dt - k
        q: Array = np.array([1.0, u, u * u, u**3, u**4, u**5]) @ self._coefficients[k]
        x = s / self._blend
        return q if x >= 1.0 else q + self._gap * (1.0 - x**3 * (10.0 - 15.0 * x + 6.0 * x * x))

    def velocity(self, s: float) -> Array:
        """Joint velocity [rad/s] at time `s` [s], without the fade. Shape (J,)."""
        s = min(max(s, 0.0), self.duration)
        k = min(int(s / self._dt), self._last)
        u = s / self._dt - k
        rates = np.array([0.0, 1.0, 2 * u, 3 * u * u, 4 * u**3, 5 * u**4]) / self._dt
        v: Array = rates @ self._coefficients[k]
        return v

    def sampled(self, dt: float) -> Array:
        """Set points every `dt` [s], the last one at the end. Shape (N, J)."""
        s = np.append(np.arange(0.0, self.duration - 1e-9, dt), self.duration)
        q = evaluate(self._coefficients, s / self._dt)
        x = np.minimum(s / self._blend, 1.0)[:, None]
        return q + self._gap * (1.0 - x**3 * (10.0 - 15.0 * x + 6.0 * x * x))


class Pace:
    """The time `s` along a profile: runs with the clock, and after `brake` slows to a stop with a smooth rate.

    The arm never leaves the path that was checked for collisions.
    """

    def __init__(self) -> None:
        self.s = 0.0
        self._start, self._length, self._into = 0.0, 0.0, 0.0

    @property
    def braking(self) -> bool:
        """Whether `brake` was called."""
        return self._length > 0.0

    @property
    def stopped(self) -> bool:
        """Whether braking is over."""
        return self.braking and self._into >= self._length

    def brake(self, velocity: Array, acceleration: Array, jerk: Array) -> None:
        """Begin to slow down from `velocity` (J,) [rad/s] within a share of the limits; later calls change nothing."""
        if self.braking:
            return
        speed = np.abs(velocity)
        by_acceleration = float((1.5 * speed / (BRAKE_SHARE * acceleration)).max())
        by_jerk = float(np.sqrt(6.0 * speed / (BRAKE_SHARE * jerk)).max())
        self._start, self._length = self.s, max(by_acceleration, by_jerk, SHORTEST_BRAKE)

    def advance(self, dt: float) -> float:
        """Let `dt` [s] pass; the new `s` [s]."""
        if not self.braking:
            self.s += dt
            return self.s
        self._into = min(self._into + dt, self._length)
        u = self._into / self._length
        self.s = self._start + self._length * (u - u**3 + u**4 / 2)
        return self.s
