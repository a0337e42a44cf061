"""Configurations at a grasp: best first, in batches, free of collision, or the one reason for none."""

import numpy as np
import pytest

from evg_app.geometry import T_GRASP_FLIPPED
from evg_app.motion.candidates import FIRST_BATCH, QUICK, Candidates, at_grasp, free_at_grasp
from evg_app.motion.kinematics import hand_of_grasp
from evg_app.motion.scene import empty_scene
from evg_app.motion.times import Times
from evg_app.types import Box, Verdict

POSE_TOLERANCE = 1e-9
TIP = (0.15, 0.15, 0.10)


@pytest.fixture(scope="module")
def asked(planner, robot, top_grasp):
    """A grasp in the base frame, and all candidates for it."""
    T = robot.T_base_task.matrix() @ top_grasp(TIP, 0.4, 0.5)
    batches = list(at_grasp(robot, planner.checker, T, planner.look_q, QUICK))
    assert [len(batch.q) for batch in batches] == [FIRST_BATCH, sum(len(b.q) for b in batches) - FIRST_BATCH]
    together = (np.concatenate([getattr(b, name) for b in batches]) for name in ("q", "branch", "flip"))
    return T, Candidates(*together)


def test_every_candidate_reaches_the_grasp_or_its_twin(planner, robot, asked):
    T, found = asked
    wanted = np.stack([hand_of_grasp(robot, T), hand_of_grasp(robot, T @ T_GRASP_FLIPPED)])[found.flip]
    np.testing.assert_allclose(planner.kinematics.fk_hand(found.q), wanted, atol=POSE_TOLERANCE)
    assert planner.kinematics.inside_limits(found.q).all()
    assert set(found.flip) == {0, 1}


def test_the_quickest_cycles_come_first(planner, robot, asked):
    cost = Times.of(robot, planner.look_q).through(planner.kinematics, asked[1].q)
    assert (np.diff(cost) >= 0).all()


def test_the_batches_together_are_all_free_candidates(planner, robot, asked):
    T, found = asked
    wall = Box("wall", (0.1, 0.6, 0.6), (0.35, -0.35, 0.5))
    scene = empty_scene(robot.model_copy(update={"obstacles": ()}))
    blocked = type(scene)(scene.points, None, type(scene.boxes).of((wall,)), scene.table)
    batches = list(free_at_grasp(robot, planner.checker, blocked, T, planner.look_q))
    clear = ~planner.checker.hits_scene(found.q, blocked, gripper=False)
    clear &= [not planner.checker.self_collision.collides(q) for q in found.q]
    assert 0 < clear.sum() < len(clear)
    np.testing.assert_array_equal(np.concatenate([batch.q for batch in batches]), found.q[clear])
    assert len(batches[0].q) <= FIRST_BATCH


def test_the_reason_for_none_is_the_first_test_that_fails(planner, robot, top_grasp, asked):
    far = robot.T_base_task.matrix() @ top_grasp(TIP)
    far[0, 3] += 2.0
    empty = empty_scene(robot)
    assert free_at_grasp(robot, planner.checker, empty, far, planner.look_q) is Verdict.IK
    everywhere = Box("block", (0.4, 0.4, 0.2), (0.45, 0.0, 0.45))
    full = type(empty)(empty.points, None, type(empty.boxes).of((everywhere,)), empty.table)
    assert free_at_grasp(robot, planner.checker, full, asked[0], planner.look_q) is Verdict.ARM_COLLISION
