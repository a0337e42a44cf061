"""The arm's forward and inverse kinematics agree with Pinocchio and with each other."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evg_app.errors import BadInput
from evg_app.geometry import T_HAND_GRASP, invert, rotation_angle
from evg_app.motion.kinematics import Kinematics, hand_of_grasp, hand_to_grasp

FK_TOLERANCE = 1e-12
IK_TOLERANCE_M = 1e-6
IK_TOLERANCE_RAD = 1e-6
MIN_SUCCESS = 0.95
READY_TOLERANCE = 2e-4
READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])


@pytest.fixture(scope="module")
def kinematics(robot):
    return Kinematics(robot)


def random_q(kinematics, seed, n):
    return np.random.default_rng(seed).uniform(kinematics.lower, kinematics.upper, (n, 7))


def test_forward_kinematics_agrees_with_pinocchio(kinematics, robot):
    data = kinematics.model.createData()
    hand = kinematics.model.getFrameId(robot.hand_link)
    q = random_q(kinematics, 0, 50)
    for row, T in zip(q, kinematics.fk_hand(q), strict=True):
        pin.framesForwardKinematics(kinematics.model, data, row)
        np.testing.assert_allclose(T, data.oMf[hand].homogeneous, atol=FK_TOLERANCE)


def test_ready_pose_has_the_published_flange_position(kinematics):
    T_hand = kinematics.fk_hand(READY)
    np.testing.assert_allclose(T_hand[:3, 3], [0.307, 0.0, 0.5903], atol=READY_TOLERANCE)
    np.testing.assert_allclose(T_hand[:3, 2], [0, 0, -1], atol=1e-9)


def test_inverse_kinematics_finds_random_reachable_poses(kinematics):
    q = random_q(kinematics, 1, 200)
    poses = kinematics.fk_hand(q)
    found = [kinematics.ik(T, READY) for T in poses]
    assert np.mean([f is not None for f in found]) > MIN_SUCCESS
    for T, answer in zip(poses, found, strict=True):
        if answer is not None:
            reached = kinematics.fk_hand(answer)
            assert np.linalg.norm(reached[:3, 3] - T[:3, 3]) < IK_TOLERANCE_M
            assert rotation_angle(reached, T) < IK_TOLERANCE_RAD
            assert kinematics.inside_limits(answer)


@given(st.integers(0, 2**31))
@settings(max_examples=50, deadline=None)
def test_closed_form_contains_the_configuration_it_came_from(kinematics, seed):
    q = random_q(kinematics, seed, 1)
    solutions = kinematics.closed_form(kinematics.fk_hand(q), q[:, 6])[0]
    gap = np.abs(solutions - q).max(axis=1)
    assert np.nanmin(gap) < 1e-5


def test_solutions_come_cheapest_first_and_inside_limits(kinematics):
    found = kinematics.solutions(kinematics.fk_hand(READY), np.stack([READY, READY + 0.1]))
    cost = kinematics.cost(np.stack(found), READY)
    assert len(found) > 10
    assert (np.diff(cost) >= 0).all()
    assert kinematics.inside_limits(np.stack(found)).all()
    np.testing.assert_allclose(kinematics.fk_hand(np.stack(found)), [kinematics.fk_hand(READY)] * len(found), atol=1e-9)


def test_a_pose_out_of_reach_has_no_solution(kinematics):
    T = kinematics.fk_hand(READY)
    T[:3, 3] = (2.0, 0.0, 0.5)
    assert kinematics.ik(T, READY) is None
    assert not kinematics.search(T, READY).any_without_limits


def test_follow_holds_q7_and_stays_on_one_branch(kinematics):
    poses = np.tile(kinematics.fk_hand(READY), (20, 1, 1))
    poses[:, 2, 3] -= np.linspace(0, 0.1, 20)
    start = kinematics.search(poses[0], READY)
    path = kinematics.follow(poses, start.q[:3, 6], start.branch[:3])
    np.testing.assert_allclose(path[:, 0], start.q[:3], atol=1e-9)
    np.testing.assert_allclose(path[..., 6], np.repeat(start.q[:3, 6:], 20, axis=1), atol=1e-12)
    assert np.abs(np.diff(path, axis=1)).max() < 0.1
    for row in path:
        np.testing.assert_allclose(kinematics.fk_hand(row), poses, atol=1e-9)


def test_limits_hold_a_margin_and_refuse_nan(kinematics, robot):
    raw = np.asarray(kinematics.model.upperPositionLimit)
    np.testing.assert_allclose(raw - kinematics.upper, robot.limits.position_margin_rad)
    assert not kinematics.inside_limits(raw) and kinematics.possible(raw)
    assert not kinematics.inside_limits(np.full(7, np.nan)) and not kinematics.possible(raw + 0.01)


def test_link_primitives_move_with_the_arm(kinematics):
    capsules = kinematics.link_primitives(READY)
    names = {capsule.name for capsule in capsules}
    assert {"panda_link0", "panda_link7", "panda_hand", "panda_leftfinger", "panda_rightfinger"} <= names
    hand = next(c for c in capsules if c.name == "panda_hand")
    T = kinematics.fk_hand(READY)
    centre = (hand.p0 + hand.p1) / 2
    np.testing.assert_allclose((invert(T) @ [*centre, 1])[:3], [0, 0, 0.03], atol=1e-3)
    fingers = [c for c in capsules if "finger" in c.name]
    gap = np.linalg.norm(fingers[0].p0 - fingers[1].p0)
    assert gap == pytest.approx(0.08 + 0.03, abs=1e-3)


def test_grasp_and_hand_frame_round_trip(robot, kinematics):
    np.testing.assert_allclose(hand_to_grasp(robot), T_HAND_GRASP)
    T_base_grasp = kinematics.fk_hand(READY) @ hand_to_grasp(robot)
    np.testing.assert_allclose(hand_of_grasp(robot, T_base_grasp), kinematics.fk_hand(READY), atol=1e-12)


def test_a_urdf_without_the_configured_joints_is_refused(robot):
    broken = robot.model_copy(update={"joints": ("a", "b", "c", "d", "e", "f", "g")})
    with pytest.raises(BadInput, match="panda_joint1"):
        Kinematics(broken)


def test_an_unknown_hand_link_is_refused(robot):
    with pytest.raises(BadInput, match="panda_hand"):
        Kinematics(robot.model_copy(update={"hand_link": "no_hand"}))
