"""Space that no camera saw: free under the optimistic policy, solid inside the cube under the conservative one."""

import numpy as np
import pytest

from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.gripper import approach_hits
from evg_app.motion.scene import SceneView
from evg_app.types import CollisionVolume, Verdict

CAN = ((0.15, 0.15, 0.09), (0.02, 0.02, 0.04))
CAN_TIP = (0.15, 0.15, 0.10)


@pytest.fixture(scope="module")
def careful(robot):
    return MotionPlanner(robot.model_copy(update={"unknown_space": "conservative"}))


@pytest.fixture(scope="module")
def shadowed(make_scene, robot):
    """A scene in which a box of task coordinates (low, high) was not seen."""

    def build(boxes, low, high):
        view = make_scene(boxes)
        volume = view.volume
        index = np.stack(np.meshgrid(*[np.arange(n) for n in volume.occupied.shape], indexing="ij"), -1)
        in_task = volume.origin + (index + 0.5) * volume.voxel_size - robot.T_base_task.matrix()[:3, 3]
        hidden = ((in_task > low) & (in_task < high)).all(axis=-1) & ~volume.occupied
        dark = CollisionVolume(volume.occupied, ~hidden, volume.origin, volume.voxel_size)
        return SceneView(view.tsdf, dark)

    return build


def test_what_was_seen_is_judged_alike_by_both_policies(planner, careful, make_scene, top_grasp, as_grasps):
    view, grasps = make_scene([CAN]), as_grasps(top_grasp(CAN_TIP))
    a, b = (p.plan_pick(grasps, view, p.look_q) for p in (planner, careful))
    assert a.verdicts == b.verdicts == (Verdict.ACCEPTED,)
    np.testing.assert_array_equal(a.pick.reach.q, b.pick.reach.q)


def test_unseen_space_around_the_target_stops_only_the_careful(planner, careful, shadowed, top_grasp, as_grasps):
    view = shadowed([CAN], (0.05, 0.05, 0.05), (0.25, 0.25, 0.30))
    grasps = as_grasps(top_grasp(CAN_TIP))
    assert planner.plan_pick(grasps, view, planner.look_q).verdicts == (Verdict.ACCEPTED,)
    verdict = careful.plan_pick(grasps, view, careful.look_q).verdicts[0]
    assert verdict in (Verdict.GRIPPER_COLLISION, Verdict.ARM_COLLISION, Verdict.NO_PATH)


def test_a_finger_may_go_into_the_shadow_behind_the_target(careful, shadowed, top_grasp, as_grasps):
    view = shadowed([CAN], (0.12, 0.17, 0.05), (0.18, 0.23, 0.12))
    decision = careful.plan_pick(as_grasps(top_grasp(CAN_TIP)), view, careful.look_q)
    assert decision.verdicts == (Verdict.ACCEPTED,)


def test_the_hand_may_not_go_there(careful, robot, shadowed, top_grasp):
    T = robot.T_base_task.matrix() @ top_grasp(CAN_TIP)
    beside = shadowed([CAN], (0.10, 0.10, 0.05), (0.20, 0.20, 0.20))
    scene = careful.prepared(beside, careful.look_q)
    assert len(scene.unseen) > 0
    assert approach_hits(careful._gripper, scene, T, robot.gripper.max_width_m, robot.pregrasp_m)


def test_nothing_floats_in_unseen_space_that_hangs_together_with_nothing(careful, shadowed):
    above = shadowed([CAN], (0.0, 0.0, 0.20), (0.3, 0.3, 0.30))
    assert len(careful.prepared(above, careful.look_q).unseen) == 0
    on_the_can = shadowed([CAN], (0.13, 0.13, 0.12), (0.17, 0.17, 0.30))
    assert len(careful.prepared(on_the_can, careful.look_q).unseen) > 0


def test_the_held_object_is_not_checked_against_unseen_space(careful, planner, shadowed, robot):
    view = shadowed([CAN], (0.12, 0.17, 0.05), (0.18, 0.23, 0.30))
    fields = [p.prepared(view, p.look_q).field.without(np.zeros((1, 3)), 1.0) for p in (planner, careful)]
    behind = robot.T_base_task.matrix()[:3, 3] + np.random.default_rng(0).uniform(0.1, 0.3, (50, 3))
    np.testing.assert_array_equal(fields[0].at(behind), fields[1].at(behind))


def test_unseen_space_outside_the_cube_is_free_for_both(planner, careful, shadowed, robot):
    view = shadowed([CAN], (-0.3, -0.3, 0.3), (0.6, 0.6, 0.7))
    for p in (planner, careful):
        scene = p.prepared(view, p.look_q)
        assert len(scene.unseen) == 0
    assert planner.prepared(view, planner.look_q).unseen_field is None


def test_unseen_voxels_of_the_table_and_of_the_arm_do_not_count(careful, shadowed):
    under = shadowed([], (0.0, 0.0, 0.0), (0.3, 0.3, 0.055))
    assert len(careful.prepared(under, careful.look_q).unseen) == 0
    in_the_cube = careful.kinematics.ik(_pose_over_the_cube(careful), careful.home_q)
    dark = shadowed([], (0.0, 0.0, 0.06), (0.3, 0.3, 0.3))
    here = len(careful.prepared(dark, in_the_cube).unseen)
    away = len(careful.prepared(dark, careful.look_q).unseen)
    assert 0 < here < away


def _pose_over_the_cube(planner):
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = (0.5, 0.0, 0.25)
    return T
