"""Timed paths keep every limit, start and end exactly, and never leave the path; the verifier catches what does."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from evg_app.config.files import load_robot
from evg_app.errors import BadInput, LimitViolation
from evg_app.motion.path import blended, line, through
from evg_app.motion.trajectory import DT, limits, position_limits, time_path, verify
from evg_app.types import Trajectory

ROBOT = load_robot("panda")
LIMIT_TOLERANCE = 1e-6
PATH_TOLERANCE = 1e-9
CORRIDOR = 0.02


def waypoints(seed, n):
    low, high = position_limits(ROBOT)
    middle, half = (low + high) / 2, (high - low) / 2
    return middle + np.random.default_rng(seed).uniform(-0.9, 0.9, (n, 7)) * half


def assert_inside_limits(trajectory):
    velocity, acceleration, jerk = limits(ROBOT)
    q = np.concatenate([[trajectory.q[0]] * 3, trajectory.q, [trajectory.q[-1]] * 3])
    for order, limit in ((1, velocity), (2, acceleration), (3, jerk)):
        assert (np.abs(np.diff(q, order, axis=0)) / DT**order / limit).max() < 1 + LIMIT_TOLERANCE


@given(st.integers(0, 2**31))
@settings(max_examples=30, deadline=None)
def test_a_straight_motion_keeps_limits_ends_and_the_line(seed):
    a, b = waypoints(seed, 2)
    trajectory = time_path(line(a, b), ROBOT)
    assert_inside_limits(trajectory)
    np.testing.assert_allclose(trajectory.q[[0, -1]], [a, b], atol=PATH_TOLERANCE)
    direction = (b - a) / np.linalg.norm(b - a)
    off = (trajectory.q - a) - ((trajectory.q - a) @ direction)[:, None] * direction
    assert np.abs(off).max() < PATH_TOLERANCE


@given(st.integers(0, 2**31), st.integers(3, 6), st.sampled_from([8, 16, 32]))
@settings(max_examples=30, deadline=None)
def test_a_rounded_path_keeps_limits_ends_and_its_curve(seed, n, intervals):
    points = waypoints(seed, n)
    path = blended(points, intervals)
    trajectory = time_path(path, ROBOT)
    assert_inside_limits(trajectory)
    np.testing.assert_allclose(trajectory.q[[0, -1]], points[[0, -1]], atol=PATH_TOLERANCE)
    assert cdist(trajectory.q[::20], path.even(4000)).min(axis=1).max() < path.length / 4000


def test_timing_uses_the_limits_it_has():
    a = waypoints(0, 1)[0]
    b = a + np.array([0.5, 0, 0, 0, 0, 0, 0])
    trajectory = time_path(line(a, b), ROBOT)
    assert np.abs(trajectory.dq).max() > 0.9 * min(limits(ROBOT)[0][0], 0.9)


def test_derivatives_match_the_positions():
    trajectory = time_path(blended(waypoints(3, 4), 16), ROBOT)
    np.testing.assert_allclose(np.gradient(trajectory.q, DT, axis=0)[2:-2], trajectory.dq[2:-2], atol=2e-3)
    assert np.abs(trajectory.dq[[0, -1]]).max() < 1e-9


def test_more_intervals_stay_closer_to_the_corner():
    points = waypoints(1, 3)
    gaps = []
    for intervals in (8, 32, 128):
        curve = blended(points, intervals).even(2000)
        gaps.append(np.linalg.norm(curve - points[1], axis=1).min())
    assert gaps[0] > gaps[1] > gaps[2] and gaps[2] < 0.1 * gaps[0] + CORRIDOR


def test_a_spline_through_close_points_passes_all_of_them():
    a, b = waypoints(2, 2)
    dense = a + np.linspace(0, 1, 20)[:, None] ** 1.2 * (b - a) * 0.2
    path = through(dense)
    np.testing.assert_allclose(path.at(path.knots), dense, atol=PATH_TOLERANCE)


def test_standing_still_is_a_trajectory_of_two_samples():
    q = waypoints(0, 1)[0]
    trajectory = time_path(line(q, q), ROBOT)
    assert trajectory.duration == pytest.approx(DT)
    np.testing.assert_array_equal(trajectory.q, [q, q])


@pytest.fixture
def good():
    return time_path(line(*waypoints(5, 2)), ROBOT)


def squeezed(trajectory, factor):
    return Trajectory(
        trajectory.joint_names, trajectory.dt * factor, trajectory.q, trajectory.dq / factor, trajectory.ddq / factor**2
    )


def test_verify_accepts_what_was_timed(good):
    verify(good, ROBOT)


def test_verify_catches_too_fast_a_motion(good):
    with pytest.raises(LimitViolation) as caught:
        verify(squeezed(good, 0.5), ROBOT)
    assert caught.value.quantity == "velocity"


def test_verify_catches_one_sample_that_jumps(good):
    q = good.q.copy()
    q[len(q) // 2, 3] += 1e-4
    with pytest.raises(LimitViolation) as caught:
        verify(replace(good, q=q), ROBOT)
    assert caught.value.joint == "panda_joint4"
    assert caught.value.quantity in ("acceleration", "jerk")


def test_verify_catches_a_motion_that_does_not_end_at_rest(good):
    half = len(good.q) // 2
    cut = replace(good, q=good.q[:half], dq=good.dq[:half], ddq=good.ddq[:half])
    with pytest.raises(LimitViolation):
        verify(cut, ROBOT)


def test_verify_catches_velocities_that_do_not_belong_to_the_positions(good):
    dq = good.dq.copy()
    dq[len(dq) // 2, 0] += 0.05
    with pytest.raises(LimitViolation):
        verify(replace(good, dq=dq), ROBOT)


def test_verify_catches_positions_beyond_the_joint_limits():
    _, high = position_limits(ROBOT)
    q = high + 0.01
    still = Trajectory(ROBOT.joints, DT, np.stack([q, q]), np.zeros((2, 7)), np.zeros((2, 7)))
    with pytest.raises(LimitViolation, match="position"):
        verify(still, ROBOT)


@pytest.mark.parametrize("field", ["q", "dq", "ddq"])
def test_verify_refuses_nan(good, field):
    array = getattr(good, field).copy()
    array[3, 2] = np.nan
    with pytest.raises(BadInput, match="finite"):
        verify(replace(good, **{field: array}), ROBOT)


def test_verify_refuses_other_joints_and_shapes(good):
    with pytest.raises(BadInput, match="joint"):
        verify(replace(good, joint_names=("x",) * 7), ROBOT)
    with pytest.raises(BadInput, match="shape"):
        verify(replace(good, dq=good.dq[:-1]), ROBOT)
