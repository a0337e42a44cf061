"""Quintic Hermite pieces through samples of position, velocity and acceleration."""

import numpy as np

from evg_app.geometry import Array


def quintics(q: Array, dq: Array, ddq: Array, dt: float) -> Array:
    """Coefficients of the quintic Hermite piece between neighbouring samples, in u = t/dt. Shape (M-1, 6, J)."""
    q0, q1 = q[:-1], q[1:]
    v0, v1 = dq[:-1] * dt, dq[1:] * dt
    a0, a1 = ddq[:-1] * dt * dt, ddq[1:] * dt * dt
    d = q1 - q0
    return np.stack(
        [
            q0,
            v0,
            a0 / 2,
            10 * d - 6 * v0 - 4 * v1 - 1.5 * a0 + 0.5 * a1,
            -15 * d + 8 * v0 + 7 * v1 + 1.5 * a0 - a1,
            6 * d - 3 * v0 - 3 * v1 - 0.5 * a0 + 0.5 * a1,
        ],
        axis=1,
    )


def evaluate(coefficients: Array, x: Array, derivative: int = 0) -> Array:
    """Value, or a derivative with respect to x, at x (N,) counted in samples. Shape (N, J)."""
    k = np.clip(x.astype(np.int64), 0, len(coefficients) - 1)
    u = (x - k)[:, None]
    c: Array = coefficients[k]
    for _ in range(derivative):
        c = c[:, 1:] * np.arange(1, c.shape[1])[:, None]
    value: Array = np.zeros((len(x), c.shape[2]))
    for n in reversed(range(c.shape[1])):
        value = value * u + c[:, n]
    return value
