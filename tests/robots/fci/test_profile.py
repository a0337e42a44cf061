"""What is streamed stays on the trajectory and within the limits, also when it is braked."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evg_app.config.files import load_robot
from evg_app.motion.feasibility import MotionPlanner
from evg_app.robots.fci import envelope
from evg_app.robots.fci.profile import BLEND_S, BRAKE_SHARE, Pace, Profile

ON_PATH_RAD = 1e-9
CYCLE = 0.001


@pytest.fixture(scope="module")
def trajectory():
    robot = load_robot("panda")
    way = MotionPlanner(robot).go_to(np.array(robot.look_q_rad), np.array(robot.home_q_rad))
    assert way is not None
    return way


def profile_of(trajectory) -> Profile:
    return Profile(trajectory.q, trajectory.dq, trajectory.ddq, trajectory.dt)


def test_the_samples_of_a_trajectory_are_streamed_exactly(trajectory):
    profile = profile_of(trajectory)
    times = np.arange(len(trajectory.q)) * trajectory.dt
    streamed = np.array([profile.at(t) for t in times])
    np.testing.assert_allclose(streamed, trajectory.q, atol=ON_PATH_RAD)
    np.testing.assert_allclose(profile.sampled(CYCLE)[::4], trajectory.q, atol=ON_PATH_RAD)


def test_set_points_between_samples_keep_the_arms_own_limits(trajectory):
    envelope.check(envelope.FR3, profile_of(trajectory).sampled(CYCLE), trajectory.joint_names)
    envelope.check(envelope.FER, profile_of(trajectory).sampled(CYCLE), trajectory.joint_names)


def test_a_gap_between_trajectory_and_controller_is_faded_out_within_the_limits(trajectory):
    profile = profile_of(trajectory)
    start = trajectory.q[0] + np.array([0.01, -0.01, 0.01, 0.01, -0.01, 0.01, -0.01])
    profile.begin_at(start)
    np.testing.assert_allclose(profile.at(0.0), start, atol=ON_PATH_RAD)
    late = np.arange(BLEND_S, profile.duration, 0.05)
    plain = profile_of(trajectory)
    for t in late:
        np.testing.assert_allclose(profile.at(t), plain.at(t), atol=ON_PATH_RAD)
    envelope.check(envelope.FR3, profile.sampled(CYCLE), trajectory.joint_names)


@settings(max_examples=30, deadline=None)
@given(share=st.floats(0.02, 0.98))
def test_braking_stays_on_the_path_and_within_its_share_of_the_limits(trajectory, share):
    profile, pace = profile_of(trajectory), Pace()
    limits = load_robot("panda").limits
    acceleration, jerk = np.array(limits.acceleration_rad_s2), np.array(limits.jerk_rad_s3)
    pace.s = share * profile.duration
    pace.brake(profile.velocity(pace.s), acceleration, jerk)
    streamed, times = [profile.at(pace.s)], [pace.s]
    while not pace.stopped:
        times.append(pace.advance(CYCLE))
        streamed.append(profile.at(times[-1]))
    assert np.all(np.diff(times) >= 0)
    q = np.array(streamed)
    assert np.abs(np.diff(q[-3:], axis=0)).max(initial=0.0) / CYCLE < 0.01
    slowing = np.abs(np.diff(q, 2, axis=0)) / CYCLE**2
    allowed = (BRAKE_SHARE + limits.acceleration_scale) * acceleration
    assert np.all(slowing <= allowed * 1.05)


def test_braking_at_full_speed_takes_less_than_half_a_second(trajectory):
    limits, pace = load_robot("panda").limits, Pace()
    fastest = np.array(limits.velocity_rad_s) * limits.velocity_scale
    pace.brake(fastest, np.array(limits.acceleration_rad_s2), np.array(limits.jerk_rad_s3))
    passed = 0.0
    while not pace.stopped:
        pace.advance(CYCLE)
        passed += CYCLE
    assert passed < 0.5


def test_braking_twice_changes_nothing():
    first, second = Pace(), Pace()
    for pace in (first, second):
        pace.brake(np.full(7, 0.5), np.full(7, 10.0), np.full(7, 5000.0))
        pace.advance(0.05)
    second.brake(np.full(7, 2.0), np.full(7, 10.0), np.full(7, 5000.0))
    assert first.advance(0.01) == second.advance(0.01)
