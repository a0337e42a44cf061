"""What the controller would abort is refused before it is sent."""

import numpy as np
import pytest

from evg_app.errors import LimitViolation
from evg_app.robots.fci.envelope import CYCLE, FER, FR3, check, speed_limits

NAMES = tuple(f"joint{k}" for k in range(1, 8))
MIDDLE = (FR3.lower + FR3.upper) / 2


def ramp(joint: int, start: float, end: float, seconds: float) -> np.ndarray:
    """A smooth move of one joint, one set point a cycle."""
    s = np.linspace(0.0, 1.0, round(seconds / CYCLE) + 1)
    q = np.repeat(MIDDLE[None], len(s), axis=0)
    q[:, joint] = start + (end - start) * (10 * s**3 - 15 * s**4 + 6 * s**5)
    return q


def test_a_gentle_move_passes():
    check(FR3, ramp(0, -0.3, 0.3, 1.0), NAMES)


def test_the_speed_towards_a_joint_end_shrinks_on_an_fr3_but_not_on_a_panda():
    q = ramp(0, 1.9, 2.6, 0.65)
    check(FER, q, NAMES)
    with pytest.raises(LimitViolation, match="joint1 velocity"):
        check(FR3, q, NAMES)


def test_at_the_end_of_a_joint_no_speed_towards_it_is_left():
    low, high = speed_limits(FR3, FR3.upper[None])
    assert np.all(high == 0.0) and np.all(low < 0.0)
    low, high = speed_limits(FR3, FR3.lower[None])
    assert np.all(low == 0.0) and np.all(high > 0.0)


def test_a_step_is_refused():
    q = ramp(3, -1.5, -1.5, 0.5)
    q[200:, 3] += 0.002
    with pytest.raises(LimitViolation, match="joint4"):
        check(FR3, q, NAMES)


def test_beyond_a_joint_end_is_refused():
    with pytest.raises(LimitViolation, match="position"):
        check(FR3, np.repeat((FR3.upper + 0.01)[None], 50, axis=0), NAMES)
