"""Every verdict is reachable, accepted picks are what they claim, and equal inputs give equal plans."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from evg_app.errors import BadInput, Refused
from evg_app.geometry import T_GRASP_FLIPPED
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.kinematics import hand_to_grasp
from evg_app.motion.scene import empty_scene, prepare
from evg_app.motion.trajectory import verify
from evg_app.types import Box, Grasps, Verdict

POSE_TOLERANCE = 1e-6
LINE_TOLERANCE = 5e-4
JOIN_TOLERANCE = 1e-9
CHECK_EVERY = 5
LEGS = ("reach", "approach", "lift", "transport", "retreat", "back")
CAN = ((0.15, 0.15, 0.09), (0.02, 0.02, 0.04))
CAN_TIP = (0.15, 0.15, 0.10)


def first(planner, grasps, view, q_start=None):
    return planner.plan_pick(grasps, view, planner.look_q if q_start is None else q_start).verdicts[0]


def grasp_pose(planner, robot, q):
    return planner.kinematics.fk_hand(q) @ hand_to_grasp(robot)


def test_a_lone_can_is_picked_and_the_motions_join(planner, robot, make_scene, top_grasp, as_grasps):
    T = top_grasp(CAN_TIP)
    decision = planner.plan_pick(as_grasps(T), make_scene([CAN]), planner.look_q)
    assert decision.verdicts == (Verdict.ACCEPTED,)
    assert decision.grasp_index == 0
    pick = decision.pick
    ends = {
        "reach": (planner.look_q, pick.approach.q[0]),
        "approach": (pick.reach.q[-1], pick.lift.q[0]),
        "lift": (pick.approach.q[-1], pick.transport.q[0]),
        "transport": (pick.lift.q[-1], pick.back.q[0]),
        "retreat": (pick.lift.q[-1], planner.look_q),
        "back": (pick.transport.q[-1], planner.look_q),
    }
    for name, (start, end) in ends.items():
        trajectory = getattr(pick, name)
        np.testing.assert_allclose(trajectory.q[[0, -1]], [start, end], atol=JOIN_TOLERANCE, err_msg=name)
        verify(trajectory, robot)
    T_wanted = robot.T_base_task.matrix() @ T @ (T_GRASP_FLIPPED if decision.flipped else np.eye(4))
    np.testing.assert_allclose(pick.T_base_grasp, T_wanted, atol=1e-9)
    np.testing.assert_allclose(grasp_pose(planner, robot, pick.approach.q[-1]), T_wanted, atol=POSE_TOLERANCE)


def test_the_object_is_let_go_with_the_tips_above_the_middle_of_the_bin(planner, make_scene, top_grasp, as_grasps):
    pick = planner.plan_pick(as_grasps(top_grasp(CAN_TIP)), make_scene([CAN]), planner.look_q).pick
    wanted, tip = (planner.kinematics.fk_hand(q) @ [0, 0, 0.112, 1] for q in (planner.drop_q, pick.transport.q[-1]))
    np.testing.assert_allclose(tip[:2], wanted[:2], atol=1e-3)
    assert tip[2] > wanted[2] - 1e-3


def test_the_approach_is_straight_along_the_grasp_and_the_lift_ends_higher(
    planner, robot, make_scene, top_grasp, as_grasps
):
    pick = planner.plan_pick(as_grasps(top_grasp(CAN_TIP, 0.3, 0.4)), make_scene([CAN]), planner.look_q).pick
    T = grasp_pose(planner, robot, pick.approach.q)
    offset = T[:, :3, 3] - pick.T_base_grasp[:3, 3]
    along = offset @ pick.T_base_grasp[:3, 2]
    assert along[0] == pytest.approx(-robot.pregrasp_m, abs=LINE_TOLERANCE)
    assert np.linalg.norm(offset - along[:, None] * pick.T_base_grasp[:3, 2], axis=1).max() < LINE_TOLERANCE
    assert np.abs(T[:, :3, :3] - pick.T_base_grasp[:3, :3]).max() < 5e-3
    lifted = grasp_pose(planner, robot, pick.lift.q[-1])
    assert lifted[2, 3] - pick.T_base_grasp[2, 3] == pytest.approx(robot.lift_m, abs=LINE_TOLERANCE)


def test_no_sample_of_an_accepted_pick_touches_the_scene(planner, robot, make_scene, top_grasp, as_grasps):
    wall = ((0.15, 0.27, 0.12), (0.10, 0.01, 0.07))
    view = make_scene([CAN, wall])
    pick = planner.plan_pick(as_grasps(top_grasp(CAN_TIP)), view, planner.look_q).pick
    scene = prepare(robot, view, planner.kinematics.link_primitives(planner.look_q))
    for name in LEGS:
        q = getattr(pick, name).q[::CHECK_EVERY]
        near_target = name in ("approach", "lift")
        hits = planner.checker.hits_scene(q, scene, gripper=not near_target)
        assert not hits.any(), name
        assert not planner.checker.self_collision.any_collides(q), name


def test_equal_inputs_give_equal_plans(planner, robot, make_scene, top_grasp, as_grasps):
    wall = ((0.15, 0.285, 0.15), (0.12, 0.01, 0.10))
    view, grasps = make_scene([CAN, wall]), as_grasps(top_grasp(CAN_TIP), top_grasp(CAN_TIP, 0.5))
    a = planner.plan_pick(grasps, view, planner.home_q)
    b = MotionPlanner(robot).plan_pick(grasps, view, planner.home_q)
    assert a.verdicts == b.verdicts
    for name in LEGS:
        np.testing.assert_array_equal(getattr(a.pick, name).q, getattr(b.pick, name).q)


def test_grasps_after_the_accepted_one_are_not_examined(planner, make_scene, top_grasp, as_grasps):
    T = top_grasp(CAN_TIP)
    decision = planner.plan_pick(as_grasps(T, T, T), make_scene([CAN]), planner.look_q)
    assert decision.verdicts == (Verdict.ACCEPTED, Verdict.NOT_EXAMINED, Verdict.NOT_EXAMINED)
    two = planner.plan_pick(as_grasps(T, T, T), make_scene([CAN]), planner.look_q, accept=2)
    assert two.verdicts == (Verdict.ACCEPTED, Verdict.ACCEPTED, Verdict.NOT_EXAMINED)
    assert two.grasp_index == 0


def test_at_most_max_examined_grasps_are_looked_at(planner, make_scene, top_grasp, as_grasps):
    bad = top_grasp((0.15, 0.15, 0.02))
    decision = planner.plan_pick(as_grasps(bad, bad, bad), make_scene(), planner.look_q, max_examined=2)
    assert decision.verdicts[2] is Verdict.NOT_EXAMINED
    assert decision.pick is None and decision.grasp_index == -1


def test_no_grasps_give_no_pick(planner, make_scene):
    decision = planner.plan_pick(Grasps.empty(), make_scene(), planner.look_q)
    assert decision.verdicts == () and decision.pick is None


@pytest.mark.parametrize("position", [(-0.01, 0.15, 0.1), (0.15, 0.31, 0.1), (np.nan, 0.1, 0.1)])
def test_verdict_out_of_workspace(planner, make_scene, top_grasp, as_grasps, position):
    T = top_grasp(CAN_TIP)
    T[:3, 3] = position
    assert first(planner, as_grasps(T), make_scene()) is Verdict.OUT_OF_WORKSPACE


@pytest.mark.parametrize("width", [0.0, 0.081, np.nan])
def test_verdict_width(planner, make_scene, top_grasp, as_grasps, width):
    assert first(planner, as_grasps(top_grasp(CAN_TIP), width=width), make_scene([CAN])) is Verdict.WIDTH


def test_verdict_gripper_collision_with_a_neighbour_and_with_the_table(planner, make_scene, top_grasp, as_grasps):
    beside = ((0.15, 0.205, 0.09), (0.02, 0.01, 0.04))
    view = make_scene([CAN, beside])
    assert first(planner, as_grasps(top_grasp(CAN_TIP)), view) is Verdict.GRIPPER_COLLISION
    assert first(planner, as_grasps(top_grasp(CAN_TIP, np.pi / 2)), view) is Verdict.ACCEPTED
    in_table = as_grasps(top_grasp((0.15, 0.15, 0.045)))
    assert first(planner, in_table, make_scene()) is Verdict.GRIPPER_COLLISION


def test_verdict_ik_when_the_wrist_is_out_of_reach(robot, make_scene, top_grasp, as_grasps):
    far_task = robot.T_base_task.model_copy(update={"xyz_m": (0.95, -0.15, -0.05)})
    far = MotionPlanner(robot.model_copy(update={"T_base_task": far_task}))
    assert first(far, as_grasps(top_grasp(CAN_TIP)), make_scene()) is Verdict.IK


def test_verdict_self_collision_when_the_gripper_would_point_up(planner, make_scene, as_grasps):
    up = np.eye(4)
    up[:3, 3] = (0.15, 0.15, 0.15)
    assert first(planner, as_grasps(up), make_scene()) is Verdict.SELF_COLLISION


def test_verdict_joint_limit_when_only_the_limits_forbid_a_flat_forward_grasp(
    planner, make_scene, top_grasp, as_grasps
):
    forward = top_grasp((0.15, 0.15, 0.12), -np.pi / 2, 1.0)
    assert forward[0, 2] > 0.8
    assert first(planner, as_grasps(forward), make_scene()) is Verdict.JOINT_LIMIT


def test_verdict_arm_collision_when_a_ceiling_hangs_over_the_wrist(planner, make_scene, top_grasp, as_grasps):
    ceiling = Box("ceiling", (0.5, 0.5, 0.02), (0.5, 0.0, 0.42))
    verdict = first(planner, as_grasps(top_grasp(CAN_TIP)), make_scene([CAN], [ceiling]))
    assert verdict is Verdict.ARM_COLLISION


def test_verdict_no_path_when_the_arm_starts_behind_walls(planner, make_scene, top_grasp, as_grasps):
    hand = planner.kinematics.fk_hand(planner.look_q)[:3, 3]
    sides = [(0.14, 0, 0), (-0.14, 0, 0), (0, 0.14, 0), (0, -0.14, 0)]
    walls = [
        Box(f"wall {k}", (0.02 if dx else 0.3, 0.02 if dy else 0.3, 0.36), tuple(hand + np.array([dx, dy, -0.05])))
        for k, (dx, dy, _) in enumerate(sides)
    ]
    floor = Box("floor", (0.3, 0.3, 0.02), tuple(hand - np.array([0, 0, 0.16])))
    verdict = first(planner, as_grasps(top_grasp(CAN_TIP)), make_scene([CAN], [*walls, floor]))
    assert verdict is Verdict.NO_PATH


def test_a_wall_between_start_and_goal_is_avoided(planner, robot, make_scene):
    k = planner.kinematics
    start, goal = (np.diag([1.0, -1.0, -1.0, 1.0]) for _ in range(2))
    start[:3, 3], goal[:3, 3] = (0.5, 0.22, 0.25), (0.5, -0.22, 0.25)
    a = k.ik(start, planner.home_q)
    b = k.ik(goal, a)
    wall = Box("wall", (0.3, 0.02, 0.3), (0.5, 0.0, 0.15))
    view = make_scene((), [wall])
    scene = prepare(robot, view, [])
    straight = a + np.linspace(0, 1, 100)[:, None] * (b - a)
    assert planner.checker.hits_scene(straight, scene).any()
    trajectory = planner.go_to(a, b, view)
    assert not planner.checker.hits_scene(trajectory.q, scene).any()
    np.testing.assert_allclose(trajectory.q[[0, -1]], [a, b], atol=JOIN_TOLERANCE)


def test_the_arm_may_leave_a_contact_it_stands_in(planner, robot):
    low = planner.kinematics.fk_hand(planner.home_q)
    low[:3, 3] = (0.5, 0.0, 0.114)
    q = planner.kinematics.ik(low, planner.home_q)
    assert planner.checker.hits_scene(q[None], empty_scene(robot))[0]
    trajectory = planner.go_to(q, planner.home_q)
    heights = planner.kinematics.fk_hand(trajectory.q)[:, 2, 3]
    assert heights.min() > low[2, 3] - 2e-3


def test_go_to_refuses_a_goal_in_the_table(planner):
    low = planner.kinematics.fk_hand(planner.home_q)
    low[2, 3] = 0.05
    with pytest.raises(Refused, match="table"):
        planner.go_to(planner.home_q, planner.kinematics.ik(low, planner.home_q))


@pytest.mark.parametrize("q", [np.full(7, np.nan), np.zeros(6), np.full(7, 5.0)])
def test_bad_joint_states_are_refused(planner, make_scene, q):
    with pytest.raises(BadInput):
        planner.go_to(q, planner.home_q)
    with pytest.raises(BadInput):
        planner.plan_pick(Grasps.empty(), make_scene(), q)


@pytest.mark.parametrize("key", ["home_q_rad", "look_q_rad"])
def test_a_configured_pose_that_collides_is_named(robot, key):
    folded = (0.0, 1.7, 0.0, -3.0, 0.0, 3.5, 0.0)
    with pytest.raises(BadInput, match=key):
        MotionPlanner(robot.model_copy(update={key: folded}))


def test_the_look_pose_leaves_the_camera_a_free_view_of_the_cube(planner, robot):
    camera = np.array([0.50, -0.52, 0.35])
    corners = np.array([[x, y, z] for x in (0.35, 0.65) for y in (-0.15, 0.15) for z in (-0.05, 0.25)])
    rng = np.random.default_rng(0)
    targets = np.concatenate([corners, rng.uniform(corners.min(0), corners.max(0), (200, 3))])
    t = np.linspace(0.02, 1, 100)[None, :, None]
    rays = (camera + t * (targets[:, None] - camera)).reshape(-1, 3)
    centers = planner.checker.centers(planner.look_q[None])[0]
    assert (cdist(rays, centers) - planner.checker.body.radius).min() > 0.03


def test_the_drop_pose_holds_the_fingers_above_the_middle_of_the_bin(planner, robot):
    T = planner.kinematics.fk_hand(planner.drop_q)
    tip = T @ [0, 0, 0.112, 1]
    np.testing.assert_allclose(tip[:2], robot.drop.bin_center_m[:2], atol=0.02)
    assert tip[2] > robot.drop.bin_center_m[2] + robot.drop.bin_size_m[2] + 0.05
    assert T[2, 2] < -0.99
