"""The verifier judges what is sent by the samples alone, across joins; timed motions pass it with room to spare."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from evg_app.config.files import load_robot
from evg_app.errors import BadInput, LimitViolation
from evg_app.motion.path import blended, line, polyline, through
from evg_app.motion.track import track
from evg_app.motion.trajectory import DT, time_path
from evg_app.motion.verify import LONGEST_DT, limits, position_limits, verify, verify_joined
from evg_app.types import Trajectory

ROBOTS = {name: load_robot(name) for name in ("panda", "fr3")}
LIMIT_TOLERANCE = 1e-6
END_TOLERANCE = 1e-12
CORRIDOR = 2e-4
"""How far the motion between two samples may be from the checked path [rad]: it may cut a corner at which it stops."""
ON_PATH = 1e-9
KINDS = ("line", "rounded", "stops", "shares")


def waypoints(robot, seed, n):
    low, high = position_limits(robot)
    middle, half = (low + high) / 2, (high - low) / 2
    return middle + np.random.default_rng(seed).uniform(-0.95, 0.95, (n, 7)) * half


def timed(robot, seed, kind):
    points = waypoints(robot, seed, 4)
    path = {
        "line": lambda: line(points[0], points[1]),
        "rounded": lambda: blended(points, 16),
        "stops": lambda: polyline(points),
        "shares": lambda: blended(points[:3], 8),
    }[kind]()
    return path, time_path(path, robot, 0.5 if kind == "shares" else 1.0)


@given(st.sampled_from(sorted(ROBOTS)), st.integers(0, 2**31), st.sampled_from(KINDS))
@settings(max_examples=60, deadline=None)
def test_samples_keep_every_limit_to_a_millionth(name, seed, kind):
    robot = ROBOTS[name]
    _, trajectory = timed(robot, seed, kind)
    rest = np.concatenate([[trajectory.q[0]] * 3, trajectory.q, [trajectory.q[-1]] * 3])
    low, high = position_limits(robot)
    assert (trajectory.q >= low).all() and (trajectory.q <= high).all()
    for order, limit in zip((1, 2, 3), limits(robot), strict=True):
        assert (np.abs(np.diff(rest, order, axis=0)) / DT**order / limit).max() <= 1 + LIMIT_TOLERANCE


@given(st.sampled_from(sorted(ROBOTS)), st.integers(0, 2**31), st.sampled_from(KINDS))
@settings(max_examples=40, deadline=None)
def test_start_and_end_are_exact_and_at_rest(name, seed, kind):
    path, trajectory = timed(ROBOTS[name], seed, kind)
    ends = path.at(np.array([0.0, path.length]))
    np.testing.assert_allclose(trajectory.q[[0, -1]], ends, atol=END_TOLERANCE)
    np.testing.assert_allclose(ends, path.waypoints[[0, -1]], atol=END_TOLERANCE)
    assert np.abs(trajectory.dq[[0, -1]]).max() == 0.0


def distance_to(path, points):
    """Distance of points (N, 7) to a path [rad]: Newton in s from both sides of the nearest of 3,000 places.

    From both sides, as beyond a corner the direction is another.
    """
    fine = np.linspace(0.0, path.length, 3000)
    on_path = path.at(fine)
    nearest = fine[np.array([np.argmin(np.linalg.norm(on_path - p, axis=1)) for p in points])]
    best = np.full(len(points), np.inf)
    for side in (-fine[1], 0.0, fine[1]):
        s = np.clip(nearest + side, 0.0, path.length)
        for _ in range(5):
            best = np.minimum(best, np.linalg.norm(points - path.at(s), axis=1))
            tangent = path.at(s, 1)
            step = ((points - path.at(s)) * tangent).sum(axis=1) / np.maximum((tangent**2).sum(axis=1), 1e-12)
            s = np.clip(s + step, 0.0, path.length)
    return best


@given(st.integers(0, 2**31), st.sampled_from(KINDS))
@example(83, "stops")
@settings(max_examples=25, deadline=None)
def test_the_motion_never_leaves_the_checked_path(seed, kind):
    """Distance to the path of the samples, and of the middles between them."""
    path, trajectory = timed(ROBOTS["panda"], seed, kind)
    count = len(trajectory.q)
    middles = (trajectory.q[:-1] + trajectory.q[1:]) / 2 - np.diff(trajectory.dq, axis=0) * DT / 8
    rows = np.arange(0, count - 1, max(count // 60, 1))
    off = distance_to(path, np.concatenate([trajectory.q[rows], middles[rows]]))
    assert off.max() < CORRIDOR
    assert kind == "stops" or off[: len(rows)].max() < ON_PATH


def test_a_near_singular_stretch_is_slowed_not_refused(planner):
    """The arm nearly stretched out: joints turn far for the last millimetres of a straight line."""
    k = planner.kinematics
    q = np.array([0.0, 0.9, 0.0, -1.0, 0.0, 1.9, 0.785])
    poses = np.tile(k.fk_hand(q), (80, 1, 1))
    outwards = poses[0, :3, 3] - [0.0, 0.0, 0.333]
    poses[:, :3, 3] += np.linspace(0, 0.08, 80)[:, None] * outwards / np.linalg.norm(outwards)
    leg = track(k, q[None], poses[None])[0]
    leg = leg[np.isfinite(leg).all(axis=1)]
    steps = np.abs(np.diff(leg, axis=0)).max(axis=1)
    assert len(leg) > 10 and steps[-1] > 2 * steps[0]
    trajectory = time_path(through(leg), ROBOTS["panda"])
    verify(trajectory, ROBOTS["panda"])
    np.testing.assert_allclose(trajectory.q[[0, -1]], leg[[0, -1]], atol=END_TOLERANCE)


@pytest.fixture(scope="module")
def parts():
    points = waypoints(ROBOTS["panda"], 11, 3)
    return tuple(time_path(line(a, b), ROBOTS["panda"]) for a, b in pairwise(points))


def test_motions_that_join_pass(parts):
    verify_joined(parts, ROBOTS["panda"])


def test_a_gap_between_motions_is_caught(parts):
    moved = replace(parts[1], q=parts[1].q + np.array([0, 0, 1e-4, 0, 0, 0, 0]))
    verify(moved, ROBOTS["panda"])
    with pytest.raises(LimitViolation, match="panda_joint3 position at a join"):
        verify_joined((parts[0], moved), ROBOTS["panda"])


def test_different_sample_intervals_cannot_follow_each_other(parts):
    slower = replace(parts[1], dt=2 * DT, dq=parts[1].dq / 2, ddq=parts[1].ddq / 4)
    with pytest.raises(BadInput, match="follow"):
        verify_joined((parts[0], slower), ROBOTS["panda"])


def test_a_motion_cut_off_while_moving_is_caught_at_the_join(parts):
    half = len(parts[0].q) // 2
    cut = replace(parts[0], q=parts[0].q[:half], dq=parts[0].dq[:half], ddq=parts[0].ddq[:half])
    with pytest.raises(LimitViolation):
        verify_joined((cut, parts[1]), ROBOTS["panda"])


def test_samples_too_far_apart_are_refused(parts):
    n = int(np.ceil(LONGEST_DT / DT)) + 1
    thin = Trajectory(parts[0].joint_names, n * DT, parts[0].q[::n], parts[0].dq[::n], parts[0].ddq[::n])
    with pytest.raises(BadInput, match="interval"):
        verify(thin, ROBOTS["panda"])


@given(st.integers(0, 6), st.integers(0, 2**31), st.sampled_from([1e-3, 3e-4]))
@settings(max_examples=25, deadline=None)
def test_any_single_sample_moved_by_a_third_of_a_milliradian_is_caught(joint, seed, size):
    _, good = timed(ROBOTS["panda"], 5, "line")
    q = good.q.copy()
    q[int(np.random.default_rng(seed).integers(1, len(q) - 1)), joint] += size
    with pytest.raises(LimitViolation):
        verify(replace(good, q=q), ROBOTS["panda"])
