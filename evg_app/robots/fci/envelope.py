"""What a Franka arm's controller accepts of a joint-position stream, checked before anything is sent.

Limits: libfranka `rate_limiting.h` and the robot's URDF (FR3: velocity limits shrink towards the joint ends); the
Panda's from libfranka 0.9. A software check, not a safety function.
"""

from dataclasses import dataclass

import numpy as np

from evg_app.errors import LimitViolation
from evg_app.geometry import Array

CYCLE = 0.001
"""The controller's cycle [s]."""
MARGIN = 0.95
"""Share of the controller's limits that evg-app lets through."""


@dataclass(frozen=True)
class Envelope:
    """Limits of one kind of arm, shape (7,) each: [rad], [rad/s], [rad/s^2], [rad/s^3].

    Attributes:
        lower, upper: joint ends.
        velocity: largest speed far from the ends.
        offset, deceleration: the speed towards an end at distance d is at most sqrt(2 * deceleration * d) - offset;
            `deceleration` is infinite where there is no such rule.
        acceleration, jerk: largest values.
    """

    lower: Array
    upper: Array
    velocity: Array
    offset: Array
    deceleration: Array
    acceleration: Array
    jerk: Array


def _seven(*values: float) -> Array:
    """Seven numbers as an array that nobody changes."""
    array = np.array(values if len(values) == 7 else values * 7, dtype=np.float64)
    array.setflags(write=False)
    return array


FR3 = Envelope(
    lower=_seven(-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196),
    upper=_seven(2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196),
    velocity=_seven(2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26),
    offset=_seven(0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35),
    deceleration=_seven(6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0),
    acceleration=_seven(10.0),
    jerk=_seven(5000.0),
)
FER = Envelope(
    lower=_seven(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    upper=_seven(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    velocity=_seven(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    offset=_seven(0.0),
    deceleration=_seven(np.inf),
    acceleration=_seven(15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),
    jerk=_seven(7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0),
)
ENVELOPES = {"fr3": FR3, "fer": FER}


def speed_limits(envelope: Envelope, q: Array) -> tuple[Array, Array]:
    """Lowest (negative) and highest joint velocity [rad/s] at positions q (N, 7). Shape (N, 7) each."""
    e = envelope
    with np.errstate(invalid="ignore"):
        up = np.sqrt(2 * e.deceleration * np.maximum(e.upper - q, 0.0)) - e.offset
        down = e.offset - np.sqrt(2 * e.deceleration * np.maximum(q - e.lower, 0.0))
    up, down = np.nan_to_num(up, nan=0.0), np.nan_to_num(down, nan=0.0)
    return np.maximum(-e.velocity, np.minimum(down, 0.0)), np.minimum(e.velocity, np.maximum(up, 0.0))


def check(envelope: Envelope, q: Array, names: tuple[str, ...]) -> None:
    """Pass when set points q (N, 7), one per cycle and at rest at both ends, are what the controller accepts.

    Raises:
        LimitViolation: the first joint and quantity that is not.
    """
    rest = np.concatenate([np.repeat(q[:1], 3, axis=0), q, np.repeat(q[-1:], 3, axis=0)])
    v, a, j = (np.diff(rest, n=n, axis=0) / CYCLE**n for n in (1, 2, 3))
    middle, half = (envelope.lower + envelope.upper) / 2, (envelope.upper - envelope.lower) / 2
    _compare(names, "position", q - middle, half)
    low, high = speed_limits(envelope, rest[1:])
    _compare(names, "velocity", np.maximum(v, 0.0), MARGIN * high)
    _compare(names, "velocity", np.minimum(v, 0.0), -MARGIN * low)
    _compare(names, "acceleration", a, MARGIN * envelope.acceleration)
    _compare(names, "jerk", j, MARGIN * envelope.jerk)


def _compare(names: tuple[str, ...], quantity: str, value: Array, limit: Array) -> None:
    """Refuse the sample that exceeds its limit most."""
    limit = np.broadcast_to(limit, value.shape)
    excess = np.abs(value) - limit
    row, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
    if excess[row, joint] > 1e-9:
        name = names[int(joint)]
        raise LimitViolation(name, quantity, float(value[row, joint]), float(limit[row, joint]))
