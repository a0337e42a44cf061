"""The complete search knows every answer, and the planner's own quick search finds what it finds."""

import numpy as np
import pytest

from evg_app.geometry import rotation_angle
from evg_app.motion.exhaustive import every_solution, numeric_solutions, reachability
from evg_app.types import Box

SAME_Q7 = np.deg2rad(1.1)
POSITION_TOLERANCE = 1e-4
ROTATION_TOLERANCE = np.deg2rad(0.1)
SEEDS = 60
TARGETS = 25
LEAST_FOUND = 0.96


@pytest.fixture(scope="module")
def scene(planner, make_scene):
    boxes = [((0.10, 0.12, 0.09), (0.02, 0.02, 0.04)), ((0.2, 0.2, 0.1), (0.03, 0.02, 0.05))]
    return planner.prepared(make_scene(boxes), planner.look_q)


def test_every_solution_reaches_the_pose_and_nearly_all_known_ones_are_near(planner):
    k = planner.kinematics
    near = 0
    for q in np.random.default_rng(0).uniform(k.lower, k.upper, (20, 7)):
        T = k.fk_hand(q)
        found = every_solution(k, T)
        near += np.abs(found[:, 6] - q[6]).min(initial=np.inf) < SAME_Q7
        np.testing.assert_allclose(k.fk_hand(found), np.broadcast_to(T, (len(found), 4, 4)), atol=1e-8)
    assert near >= 17


def test_numeric_search_reaches_poses_to_a_tenth_of_a_millimetre_and_degree(planner):
    k = planner.kinematics
    rng = np.random.default_rng(1)
    T = k.fk_hand(rng.uniform(k.lower, k.upper))
    found = numeric_solutions(k, T, rng.uniform(k.lower, k.upper, (SEEDS, 7)))
    assert len(found) > SEEDS / 20
    for reached in k.fk_hand(found):
        assert np.linalg.norm(reached[:3, 3] - T[:3, 3]) < POSITION_TOLERANCE
        assert rotation_angle(reached, T) < ROTATION_TOLERANCE
    assert k.inside_limits(found).all()


def test_the_planner_finds_what_the_complete_search_finds(planner, robot, scene, top_grasp):
    rng = np.random.default_rng(2)
    results = []
    for _ in range(TARGETS):
        T = top_grasp(rng.uniform([0.03, 0.03, 0.08], [0.27, 0.27, 0.2]), rng.uniform(-3, 3), rng.uniform(0, 1.2))
        T_base_grasp = robot.T_base_task.matrix() @ T
        results.append(reachability(planner, scene, T_base_grasp, planner.look_q, seeds=SEEDS))
    configurations = sum(r.configuration for r in results)
    legs = sum(r.legs for r in results)
    assert legs > TARGETS / 2
    assert sum(r.found_configuration for r in results) >= LEAST_FOUND * configurations
    assert sum(r.found_legs for r in results) >= LEAST_FOUND * legs


def test_a_grasp_under_a_ceiling_is_reachable_for_neither(planner, robot, make_scene, top_grasp):
    ceiling = Box("ceiling", (0.6, 0.6, 0.02), (0.5, 0.0, 0.30))
    scene = planner.prepared(make_scene((), [ceiling]), planner.look_q)
    T_base_grasp = robot.T_base_task.matrix() @ top_grasp((0.15, 0.15, 0.10))
    found = reachability(planner, scene, T_base_grasp, planner.look_q, seeds=SEEDS)
    assert not (found.configuration or found.legs or found.found_configuration or found.found_legs)
