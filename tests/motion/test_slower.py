"""A slowed trajectory keeps its path and shrinks speed, acceleration and jerk."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evg_app.config.files import load_robot
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.slower import slowed
from evg_app.motion.trajectory import DT, verify

ON_PATH_RAD = 1e-6
RINGING = 0.01
"""Relative excess of acceleration where the jerk jumps between samples."""
ROBOT = load_robot("panda")


@pytest.fixture(scope="module")
def way():
    found = MotionPlanner(ROBOT).go_to(np.array(ROBOT.look_q_rad), np.array(ROBOT.home_q_rad))
    assert found is not None
    return found


@settings(max_examples=15, deadline=None)
@given(share=st.floats(0.05, 0.98))
def test_speed_shrinks_with_the_share_and_the_limits_hold(way, share):
    slow = slowed(way, share)
    verify(slow, ROBOT)
    assert slow.duration == pytest.approx(way.duration / share, abs=DT)
    assert np.abs(slow.dq).max() <= share * np.abs(way.dq).max() * (1 + 1e-6)
    assert np.abs(slow.ddq).max() <= share**2 * np.abs(way.ddq).max() * (1 + RINGING)


def test_the_path_is_the_same(way):
    slow = slowed(way, 0.25)
    np.testing.assert_allclose(slow.q[::4][: len(way.q)], way.q, atol=ON_PATH_RAD)
    np.testing.assert_array_equal(slow.q[[0, -1]], way.q[[0, -1]])
    assert np.all(slow.dq[[0, -1]] == 0.0)


def test_full_speed_changes_nothing(way):
    assert slowed(way, 1.0) is way
