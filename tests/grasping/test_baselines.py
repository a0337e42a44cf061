"""The baselines: surface normals are right, antipodal grasps are antipodal, random ones are random."""

import numpy as np
import pytest

from evg_app.geometry import is_transform, transform_points
from evg_app.grasping.load import load_planner
from evg_app.grasping.surface import surface_points

NORMAL_TOLERANCE = 0.35
"""Mean sine of the angle between a ball's true normals and those of a 7.5 mm grid."""
SURFACE_TOLERANCE = 0.004
"""[m], median distance of surface points to the ball."""


def test_surface_points_and_normals_are_those_of_the_balls(grid):
    seen = surface_points(grid.values).on_objects()
    centre, radius = np.array([0.20, 0.14, 0.08]), 0.03
    ball = np.linalg.norm(seen.points - centre, axis=1) < radius + 0.01
    radial = seen.points[ball] - centre
    assert ball.sum() > 10
    assert np.median(np.abs(np.linalg.norm(radial, axis=1) - radius)) < SURFACE_TOLERANCE
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    assert np.linalg.norm(np.cross(radial, seen.normals[ball]), axis=1).mean() < NORMAL_TOLERANCE
    assert np.linalg.norm(seen.normals, axis=1) == pytest.approx(1.0)


def test_the_table_has_upward_normals_and_is_no_object(table_only):
    seen = surface_points(table_only.values)
    assert len(seen.points) > 500 and np.median(seen.normals[:, 2]) > 0.95
    assert len(seen.on_objects().points) == 0
    assert len(load_planner("antipodal").plan(table_only)) == 0
    assert len(load_planner("random").plan(table_only)) == 0


@pytest.mark.parametrize("model", ["antipodal", "random"])
def test_baselines_rank_rigid_grasps_repeatably(grid, model):
    p = load_planner(model)
    grasps, again, other = p.plan(grid, 1), p.plan(grid, 1), p.plan(grid, 2)
    assert len(grasps) > 5 and p.name == model and p.weights_sha256 == ""
    assert all(is_transform(T) for T in grasps.T_task_grasp)
    assert (np.diff(grasps.score) <= 0).all()
    assert np.array_equal(grasps.T_task_grasp, again.T_task_grasp)
    assert not np.array_equal(grasps.T_task_grasp[:5], other.T_task_grasp[:5])


def test_the_best_antipodal_grasp_closes_on_seen_surface_without_touching_it_first(grid):
    seen = surface_points(grid.values)
    grasps = load_planner("antipodal").plan(grid)
    for T, width in zip(grasps.T_task_grasp[:5], grasps.width[:5], strict=True):
        local = transform_points(np.linalg.inv(T), seen.points)
        between = (np.abs(local[:, 0]) < 0.01) & (np.abs(local[:, 1]) < 0.04) & (local[:, 2] > 0) & (local[:, 2] < 0.05)
        assert between.sum() >= 3
        palm = (np.abs(local) < [0.02, 0.06, 1]).all(axis=1) & (local[:, 2] < 0) & (local[:, 2] > -0.05)
        assert not palm.any()
        assert 0.0099 <= width <= 0.0699
        tip_height = T[2, 3] + T[2, 2] * 0.05
        assert tip_height > 0.05
