"""The table's perception: where the camera is, what counts as an object, the arm's own links."""

import numpy as np
import pytest

from evg_app.geometry import invert, look_at, make, translation
from evg_app.picking.perceive import TablePerception, points_above_table
from evg_app.types import Capsule, Frame, Intrinsics

CAMERA = Intrinsics(160, 120, 140.0, 140.0, 80.0, 60.0)
T_BASE_TASK = translation(0.35, -0.15, -0.05)
T_TASK_CAM = make(look_at([0.15, 0.149, 0.6], [0.15, 0.15, 0.05], [0.0, 1.0, 0.0])[:3, :3], [0.15, 0.15, 0.6])
"""A camera straight above the middle of the workspace."""
TABLE_MM = 550
"""Depth of the table below it [mm]."""


def _frame(block_mm: int = 0) -> Frame:
    depth = np.full((120, 160), TABLE_MM, np.uint16)
    depth[50:70, 70:90] -= block_mm
    return Frame(depth, 0.001, CAMERA, 1.0, "cam")


def _perception(links=()) -> TablePerception:
    return TablePerception(T_BASE_TASK, lambda q: T_BASE_TASK @ T_TASK_CAM, lambda q: links)


def test_a_bare_table_has_no_points_above_it_and_a_block_has():
    assert points_above_table(_frame(), invert(T_TASK_CAM)) == 0
    assert points_above_table(_frame(block_mm=40), invert(T_TASK_CAM)) == pytest.approx(100, abs=10)


def test_the_view_holds_the_planner_s_grid_and_the_collision_volume():
    view = _perception().view(_frame(block_mm=40), np.zeros(7))
    assert view.tsdf.values.shape == (40, 40, 40) and (view.tsdf.values > 0).any()
    assert view.volume.occupied.any() and view.points > 50
    top = np.argwhere(view.volume.occupied)[:, 2].max() * view.volume.voxel_size + view.volume.origin[2]
    assert top == pytest.approx(T_BASE_TASK[2, 3] + 0.05 + 0.04, abs=view.volume.voxel_size)


def test_the_arm_s_own_links_leave_the_image_and_the_rest_stays():
    middle = T_BASE_TASK[:3, 3] + np.array([0.15, 0.15, 0.09])
    perception = _perception([Capsule(middle, middle, 0.03, "hand")])
    clean = perception.clean(_frame(block_mm=40), np.zeros(7))
    assert clean.depth[60, 80] == 0 and clean.depth[5, 5] == TABLE_MM
    assert clean.depth.dtype == np.uint16


def test_an_image_of_nothing_is_a_problem_with_advice():
    blind = Frame(np.zeros((120, 160), np.uint16), 0.001, CAMERA, 1.0, "cam")
    assert "depth" in _perception().problem(blind, np.zeros(7))
    assert _perception().problem(_frame(block_mm=40), np.zeros(7)) == ""


def test_an_arm_before_the_whole_workspace_hinders_a_plan_but_is_not_blindness():
    arm = _frame()
    arm.depth[:] = 200
    nothing = Frame(np.zeros_like(arm.depth), 0.001, CAMERA, 1.0, "cam")
    assert "No surface" in _perception().problem(arm, np.zeros(7))
    assert _perception().blind(arm, np.zeros(7)) == ""
    assert "depth" in _perception().blind(nothing, np.zeros(7))


def test_the_share_of_valid_depth_that_the_camera_config_asks_for_decides():
    half = _frame(block_mm=40)
    half.depth[:, ::2] = 0
    patient, strict = (
        TablePerception(T_BASE_TASK, lambda q: T_BASE_TASK @ T_TASK_CAM, lambda q: (), min_valid=least)
        for least in (0.4, 0.6)
    )
    assert patient.problem(half, np.zeros(7)) == ""
    assert "without depth" in strict.problem(half, np.zeros(7))
