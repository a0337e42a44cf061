"""Least-motion tracking reaches every pose, stays smooth, and does not swing the elbow."""

import numpy as np

from evg_app.motion.candidates import QUICK, THOROUGH
from evg_app.motion.legs import find_legs
from evg_app.motion.scene import empty_scene
from evg_app.motion.track import jacobian, pose_error, track

READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
POSE_TOLERANCE = 1e-6
STEP = 1e-6
LARGEST_JUMP = 0.05


def upwards(kinematics, q, rise=0.15, count=31):
    poses = np.tile(kinematics.fk_hand(q), (count, 1, 1))
    poses[:, 2, 3] += np.linspace(0, rise, count)
    return poses


def test_the_jacobian_is_the_derivative_of_the_pose(planner):
    k = planner.kinematics
    q = np.random.default_rng(0).uniform(k.lower, k.upper)
    J = jacobian(k.frames(q[None]), k.fk_hand(q[None]))[0]
    for joint in range(7):
        moved = q.copy()
        moved[joint] += STEP
        change = pose_error(k.fk_hand(q[None]), k.fk_hand(moved[None]))[0] / STEP
        np.testing.assert_allclose(J[:, joint], change, atol=1e-5)


def test_every_pose_is_reached_without_a_jump(planner):
    k = planner.kinematics
    poses = upwards(k, READY)
    path = track(k, READY[None], poses[None])[0]
    np.testing.assert_allclose(k.fk_hand(path), poses, atol=POSE_TOLERANCE)
    assert np.abs(np.diff(path, axis=0)).max() < LARGEST_JUMP


def test_the_joints_move_less_than_with_q7_held(planner):
    k = planner.kinematics
    low = READY.copy()
    low[2], low[4] = 0.4, -0.4
    poses = upwards(k, low)
    least = track(k, low[None], poses[None])[0]
    branch = int(np.nanargmin(np.abs(k.closed_form(poses[:1], low[6:])[0] - low).max(axis=1)))
    held = k.follow(poses, low[6:], np.array([branch]))[0]
    assert np.abs(np.diff(least, axis=0)).sum() < np.abs(np.diff(held, axis=0)).sum()


def test_a_pose_out_of_reach_ends_the_row_only(planner):
    k = planner.kinematics
    poses = np.stack([upwards(k, READY, 0.15), upwards(k, READY, 1.5)])
    path = track(k, np.stack([READY, READY]), poses)
    assert np.isfinite(path[0]).all() and np.isfinite(path[1, 0]).all() and np.isnan(path[1, -1]).all()


def test_a_thorough_search_finds_at_least_as_many_legs(planner, robot, top_grasp):
    scene = empty_scene(robot)
    T = robot.T_base_task.matrix() @ top_grasp((0.15, 0.15, 0.10), 0.4, 0.5)
    quick = list(find_legs(robot, planner.checker, scene, T, planner.look_q, QUICK))
    thorough = list(find_legs(robot, planner.checker, scene, T, planner.look_q, THOROUGH))
    assert len(thorough) > len(quick) > 0
    assert min(leg.cost for leg in thorough) <= min(leg.cost for leg in quick) + 0.05
