"""What the config declares counts: boxes in the room, and bodies fixed to the arm."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from evg_app.config.arm import AttachedBody
from evg_app.config.models import BoxModel
from evg_app.errors import BadInput
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.scene import Boxes, Scene, empty_scene, table_plane
from evg_app.motion.spheres import arm_spheres
from evg_app.types import Box, Verdict

READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
CAN = ((0.15, 0.15, 0.09), (0.02, 0.02, 0.04))
CAN_TIP = (0.15, 0.15, 0.10)
BRACKET = AttachedBody(
    name="camera bracket", link="panda_hand", from_m=(0.06, 0.0, 0.02), to_m=(0.10, 0.0, 0.04), radius_m=0.02
)
LONG_POLE = AttachedBody(
    name="pole", link="panda_hand", from_m=(0.05, 0.0, 0.0), to_m=(0.30, 0.0, -0.25), radius_m=0.02
)


def with_bodies(robot, *bodies):
    return MotionPlanner(robot.model_copy(update={"attached": bodies}))


@pytest.fixture(scope="module")
def bracketed(robot):
    return with_bodies(robot, BRACKET)


def test_a_declared_box_where_the_arm_must_be_is_named(robot):
    box = BoxModel(name="box at the drop pose", size_m=(0.1, 0.1, 0.1), center_m=(0.3, 0.5, 0.35))
    with pytest.raises(BadInput, match=r"q_rad of robot 'panda' touches a declared box"):
        MotionPlanner(robot.model_copy(update={"obstacles": (*robot.obstacles, box)}))


def test_every_motion_of_a_pick_keeps_clear_of_a_declared_wall(robot, make_scene, top_grasp, as_grasps):
    wall = BoxModel(name="wall", size_m=(0.6, 0.04, 0.9), center_m=(0.5, -0.26, 0.45))
    walled = MotionPlanner(robot.model_copy(update={"obstacles": (wall,)}))
    decision = walled.plan_pick(as_grasps(top_grasp(CAN_TIP, 1.2)), make_scene([CAN]), walled.look_q)
    assert decision.pick is not None and clear(walled, decision.pick, wall)


def clear(planner, pick, wall):
    boxes = Boxes.of((wall.box(),))
    scene = Scene(np.zeros((0, 3)), None, boxes, table_plane(planner.robot))
    legs = (pick.reach, pick.approach, pick.lift, pick.transport, pick.back, pick.retreat)
    return not any(planner.checker.hits_scene(leg.q[::5], scene).any() for leg in legs)


def test_a_declared_body_is_covered_by_spheres_that_move_with_its_link(bracketed):
    body = bracketed.checker.body
    rows = [k for k, name in enumerate(body.names) if name == "camera bracket"]
    assert rows and not body.gripper[rows].any()
    T = bracketed.kinematics.fk_hand(READY)
    line = np.linspace(BRACKET.from_m, BRACKET.to_m, 50) @ T[:3, :3].T + T[:3, 3]
    rim = np.concatenate([line + d * BRACKET.radius_m * 0.99 for d in np.concatenate([np.eye(3), -np.eye(3)])])
    centers = bracketed.checker.centers(READY[None])[0][rows]
    assert (cdist(np.concatenate([line, rim]), centers) - body.radius[rows]).min(axis=1).max() < 0


def test_a_declared_body_hits_boxes_that_the_bare_arm_clears(planner, bracketed, robot):
    T = planner.kinematics.fk_hand(READY)
    beside = tuple((T @ [0.10, 0.0, 0.04, 1.0])[:3])
    boxes = Boxes.of((Box("b", (0.01, 0.01, 0.01), beside),))
    scene = Scene(np.zeros((0, 3)), None, boxes, table_plane(robot))
    assert not planner.checker.hits_scene(READY[None], scene)[0]
    assert bracketed.checker.hits_scene(READY[None], scene, gripper=False)[0]
    assert "camera bracket" in bracketed.checker.what_is_hit(READY, scene)


def test_a_declared_body_is_checked_against_the_arm_itself(planner, robot):
    poled = with_bodies(robot, LONG_POLE)
    k = poled.kinematics
    q = np.random.default_rng(0).uniform(k.lower, k.upper, (300, 7))
    mine = [row for row in q if not planner.checker.self_collision.collides(row)]
    hits = [poled.checker.self_collision.what_collides(row) for row in mine]
    assert any("pole" in hit for hit in hits) and not all(hits)
    assert planner.checker.self_collision.what_collides(READY) == ""


def test_points_of_a_declared_body_are_removed_from_the_scene(bracketed):
    names = {capsule.name for capsule in bracketed.kinematics.link_primitives(READY)}
    assert "camera bracket" in names


def test_a_declared_body_that_touches_the_arm_at_home_is_named(robot):
    through = AttachedBody(
        name="bad cable", link="panda_hand", from_m=(0.0, 0.0, 0.0), to_m=(0.0, 0.0, -0.35), radius_m=0.05
    )
    with pytest.raises(BadInput, match="bad cable"):
        with_bodies(robot, through)


def test_a_declared_body_on_an_unknown_link_is_refused(robot):
    lost = BRACKET.model_copy(update={"link": "no_such_link"})
    with pytest.raises(BadInput, match=r"camera bracket.*panda_link7"):
        with_bodies(robot, lost)


def test_a_pick_with_a_camera_bracket_is_still_planned(bracketed, make_scene, top_grasp, as_grasps):
    decision = bracketed.plan_pick(as_grasps(top_grasp(CAN_TIP)), make_scene([CAN]), bracketed.look_q)
    assert decision.verdicts == (Verdict.ACCEPTED,)


def test_without_declared_bodies_nothing_changes(planner, robot):
    body = arm_spheres(planner.kinematics.meshes, ("panda_hand", "panda_leftfinger", "panda_rightfinger"))
    np.testing.assert_array_equal(body.center, planner.checker.body.center)
    assert empty_scene(robot).solid is None
