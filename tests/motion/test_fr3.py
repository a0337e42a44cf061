"""The FR3: the Panda's kinematics under its own names, its own limits, and slower joints near their ends."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evg_app.config.files import load_robot
from evg_app.errors import LimitViolation
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.path import line
from evg_app.motion.trajectory import DT, time_path
from evg_app.motion.verify import position_limits, velocity_range, verify
from evg_app.types import Verdict

ROBOT = load_robot("fr3")
READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
TOLERANCE = 1e-6
PUBLISHED = {
    0: (2.0, 2.62, -2.62),
    1: (1.7, 0.48892, -2.62),
    3: (-0.3, 0.81068, -2.62),
    5: (0.7, 4.18, -0.97283),
    6: (2.9, 1.66653, -5.26),
}
"""Joint, position, and Franka's velocity limits there, worked out by hand from the published formulas."""


@pytest.fixture(scope="module")
def fr3():
    return MotionPlanner(ROBOT)


def test_it_has_the_pandas_kinematics_and_its_own_limits(fr3, planner):
    np.testing.assert_array_equal(fr3.kinematics.fk_hand(READY), planner.kinematics.fk_hand(READY))
    low, high = position_limits(ROBOT)
    assert low[5] == pytest.approx(0.5445) and high[5] == pytest.approx(4.5169)
    assert not fr3.kinematics.possible(np.array([0, 0, 0, -2, 0, 0.4, 0]))
    assert planner.kinematics.possible(np.array([0, 0, 0, -2, 0, 0.4, 0]))


def test_a_pick_is_planned_under_its_own_joint_names(fr3, make_scene, top_grasp, as_grasps):
    grasps = as_grasps(top_grasp((0.15, 0.15, 0.10)))
    decision = fr3.plan_pick(grasps, make_scene([((0.15, 0.15, 0.09), (0.02, 0.02, 0.04))]), fr3.look_q)
    assert decision.verdicts == (Verdict.ACCEPTED,)
    assert decision.pick.reach.joint_names == tuple(f"fr3_joint{k}" for k in range(1, 8))


@pytest.mark.parametrize("joint", PUBLISHED)
def test_velocity_limits_near_the_ends_are_frankas(joint):
    position, highest, lowest = PUBLISHED[joint]
    full = ROBOT.model_copy(update={"limits": ROBOT.limits.model_copy(update={"velocity_scale": 1.0})})
    q = READY.copy()
    q[joint] = position
    low, high = velocity_range(full, q[None])
    assert high[0, joint] == pytest.approx(highest, abs=1e-4)
    assert low[0, joint] == pytest.approx(lowest, abs=1e-4)


@given(st.integers(0, 2**31), st.floats(0.9, 1.0))
@settings(max_examples=25, deadline=None)
def test_motions_between_the_ends_of_the_joints_keep_the_shrinking_limits(seed, share):
    low, high = position_limits(ROBOT)
    low, high = low + ROBOT.limits.position_margin_rad, high - ROBOT.limits.position_margin_rad
    middle, half = (low + high) / 2, (high - low) / 2
    sign = np.random.default_rng(seed).choice([-1.0, 1.0], 7)
    trajectory = time_path(line(middle - share * sign * half, middle + share * sign * half), ROBOT)
    slowest, fastest = velocity_range(ROBOT, (trajectory.q[:-1] + trajectory.q[1:]) / 2)
    velocity = np.diff(trajectory.q, axis=0) / DT
    assert (velocity <= fastest + TOLERANCE).all() and (velocity >= slowest - TOLERANCE).all()


def test_the_verifier_refuses_what_is_too_fast_only_because_an_end_is_near():
    without = ROBOT.model_copy(update={"limits": ROBOT.limits.model_copy(update={"near_ends": None})})
    near, nearer = READY.copy(), READY.copy()
    near[1], nearer[1] = 1.2, 1.7
    fast = time_path(line(near, nearer), without)
    verify(fast, without)
    with pytest.raises(LimitViolation, match="fr3_joint2 velocity"):
        verify(fast, ROBOT)
    assert time_path(line(near, nearer), ROBOT).duration > fast.duration
    away = time_path(line(nearer, near), without)
    with pytest.raises(LimitViolation, match="fr3_joint2 velocity"):
        verify(replace(away, q=away.q[::-1], dq=-away.dq[::-1], ddq=away.ddq[::-1]), ROBOT)


def test_leaving_an_end_is_not_slowed():
    without = ROBOT.model_copy(update={"limits": ROBOT.limits.model_copy(update={"near_ends": None})})
    at_end, away = READY.copy(), READY.copy()
    at_end[1], away[1] = 1.75, 1.0
    np.testing.assert_array_equal(time_path(line(at_end, away), ROBOT).q, time_path(line(at_end, away), without).q)
