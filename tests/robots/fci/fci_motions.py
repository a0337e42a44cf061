"""Motions for tests: planned ones, and a plain smooth turn."""

import time

import numpy as np

from evg_app.robots.fci.arm import FciArm, FciMotion
from evg_app.types import MotionResult, Trajectory

TURN = np.array([0.15, -0.1, 0.1, 0.1, 0.1, -0.1, 0.2])


def turn(arm: FciArm, by: np.ndarray, duration: float = 1.0, dt: float = 0.004) -> Trajectory:
    """A smooth motion from where the arm is."""
    n = round(duration / dt)
    s = np.arange(n + 1)[:, None] / n
    q = arm.state().q + (10 * s**3 - 15 * s**4 + 6 * s**5) * by
    dq = (30 * s**2 - 60 * s**3 + 30 * s**4) / duration * by
    return Trajectory(arm.joint_names, dt, q, dq, (60 * s - 180 * s**2 + 120 * s**3) / duration**2 * by)


def end_of(motion: FciMotion, timeout: float = 30.0) -> MotionResult:
    """Wait in slices, as the loop does."""
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        result = motion.wait(0.02)
        if result is not None:
            return result
    raise AssertionError("the motion never ended")


def until_moving(arm: FciArm, motion: FciMotion, speed: float = 0.05) -> None:
    """Wait until the arm really moves."""
    for _ in range(1000):
        assert motion.wait(0.005) is None
        if np.abs(arm.state().dq).max() > speed:
            return
    raise AssertionError("the arm never moved")


def rests(arm: FciArm, seconds: float = 0.4, within: float = 2e-3) -> bool:
    """Whether the arm, as the other side of the wire measures it, stays where it is."""
    before = arm.state().q
    time.sleep(seconds)
    return bool(np.abs(arm.state().q - before).max() < within)
