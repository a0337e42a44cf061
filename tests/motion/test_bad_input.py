"""Whatever is handed in, there is a clear error or an honest "no": never a motion."""

from dataclasses import replace

import numpy as np
import pytest

from evg_app.config.files import load_robot
from evg_app.errors import BadInput
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.scene import SceneView
from evg_app.types import CollisionVolume, Grasps, TsdfGrid, Verdict

CAN = ((0.15, 0.15, 0.09), (0.02, 0.02, 0.04))
CAN_TIP = (0.15, 0.15, 0.10)


def with_nan(q):
    q = np.array(q)
    q[3] = np.nan
    return q


def test_nan_joint_states_are_refused_before_anything_is_planned(planner, make_scene, top_grasp, as_grasps):
    broken = with_nan(planner.look_q)
    with pytest.raises(BadInput, match="finite"):
        planner.plan_pick(as_grasps(top_grasp(CAN_TIP)), make_scene([CAN]), broken)
    for a, b in ((broken, planner.home_q), (planner.home_q, broken)):
        with pytest.raises(BadInput, match="finite"):
            planner.go_to(a, b)


def test_a_goal_outside_the_limits_names_joint_value_and_limits(planner):
    goal = planner.home_q.copy()
    goal[3] = 0.5
    with pytest.raises(BadInput, match=r"panda_joint4 = 0\.5000 rad.*-3\.07"):
        planner.go_to(planner.home_q, goal)


def test_a_scene_in_which_nothing_was_seen_still_gives_a_checked_answer(planner, top_grasp, as_grasps):
    nothing = np.zeros((40, 40, 40), dtype=np.float32)
    volume = np.zeros((64, 64, 64), dtype=bool)
    view = SceneView(
        TsdfGrid(nothing, nothing > 1), CollisionVolume(volume, volume, np.array([0.1, -0.4, -0.15]), 0.0125)
    )
    decision = planner.plan_pick(as_grasps(top_grasp(CAN_TIP)), view, planner.look_q)
    assert decision.verdicts == (Verdict.ACCEPTED,)


def test_a_scene_that_is_full_gives_no_pick_and_a_reason_each(planner, robot, top_grasp, as_grasps):
    rng = np.random.default_rng(0)
    surface = rng.uniform(0.3, 0.7, (40, 40, 40)).astype(np.float32)
    volume = np.ones((64, 64, 64), dtype=bool)
    view = SceneView(
        TsdfGrid(surface, surface > 0), CollisionVolume(volume, volume, np.array([0.1, -0.4, -0.15]), 0.0125)
    )
    decision = planner.plan_pick(as_grasps(top_grasp(CAN_TIP), top_grasp(CAN_TIP, 1.0)), view, planner.look_q)
    assert decision.pick is None
    assert set(decision.verdicts) == {Verdict.GRIPPER_COLLISION}


@pytest.mark.parametrize("part", ["values", "origin", "mask", "voxel"])
def test_a_broken_scene_is_refused(planner, make_scene, part):
    view = make_scene([CAN])
    tsdf, volume = view.tsdf, view.volume
    values = tsdf.values.copy()
    values[3, 3, 3] = np.nan
    broken = {
        "values": SceneView(replace(tsdf, values=values), volume),
        "origin": SceneView(tsdf, replace(volume, origin=np.array([0.1, np.inf, 0.0]))),
        "mask": SceneView(replace(tsdf, observed=tsdf.observed[:10]), volume),
        "voxel": SceneView(tsdf, replace(volume, voxel_size=0.0)),
    }[part]
    with pytest.raises(BadInput, match="nothing was planned"):
        planner.plan_pick(Grasps.empty(), broken, planner.look_q)


def test_grasps_that_are_no_numbers_get_a_verdict(planner, make_scene, top_grasp, as_grasps):
    bad = top_grasp(CAN_TIP)
    bad[:3, :3] = np.nan
    decision = planner.plan_pick(as_grasps(bad), make_scene([CAN]), planner.look_q)
    assert decision.verdicts == (Verdict.OUT_OF_WORKSPACE,) and decision.pick is None


def test_a_urdf_whose_joints_do_not_match_the_config_is_refused(robot):
    other = robot.model_copy(update={"joints": tuple(f"fr3_joint{k}" for k in range(1, 8))})
    with pytest.raises(BadInput, match=r"panda_joint1.*fr3_joint1"):
        MotionPlanner(other)
    swapped = robot.model_copy(update={"joints": (robot.joints[1], robot.joints[0], *robot.joints[2:])})
    with pytest.raises(BadInput, match="in order"):
        MotionPlanner(swapped)


def test_a_missing_urdf_is_refused_with_its_name(robot):
    with pytest.raises(BadInput, match=r"no_such\.urdf"):
        MotionPlanner(robot.model_copy(update={"urdf": "no_such.urdf"}))


def test_a_file_that_is_no_urdf_is_refused(robot, tmp_path):
    path = tmp_path / "broken.urdf"
    path.write_text("<robot name='x'><link")
    with pytest.raises(BadInput, match=r"broken\.urdf"):
        MotionPlanner(robot.model_copy(update={"urdf": str(path)}))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("velocity_rad_s: [2.175, ", "velocity_rad_s: ["),
        ("position_margin_rad: 0.03", "position_margin_rad: -1"),
        ("lift_m: 0.15", "lift_m: 0.15\nunknown_space: brave"),
        ("lift_m: 0.15", "lift_m: 0.15\nattached: [{name: a, link: b, from_m: [0, 0, 0], to_m: [0, 0, 1]}]"),
        ("  position_margin_rad", "  position_rad: [[0, 1]]\n  position_margin_rad"),
    ],
)
def test_a_wrong_robot_file_is_refused_with_its_line(tmp_path, key, value):
    from evg_app.config.files import find

    text = find("robot", "robot_configs", "panda").read_text().replace(key, value, 1)
    (tmp_path / "robot_configs").mkdir()
    (tmp_path / "robot_configs" / "panda.yaml").write_text(text)
    with pytest.raises(BadInput, match=r"panda\.yaml"):
        load_robot("panda", tmp_path)
