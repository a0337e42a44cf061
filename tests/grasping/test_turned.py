"""Planners of one side: the grid is turned to it and the grasps are turned back."""

import numpy as np
import pytest

from evg_app.geometry import VOXEL_SIZE, Array, camera_on_sphere, make, rotation_about
from evg_app.grasping.protocol import Grid, grid_values
from evg_app.grasping.turned import OneSided, plan_turned, quarter_turns, turn
from evg_app.types import Grasps

TOLERANCE = 1e-9
SIDE = -np.pi / 2


class BrightestVoxel:
    """Grasps the brightest voxel, approaching along the side it was trained on (+y)."""

    name, weights_sha256, training_azimuth = "brightest", "", SIDE

    def plan(self, grid: Grid, seed: int = 0) -> Grasps:
        values = grid_values(grid)
        ijk = np.array(np.unravel_index(values.argmax(), values.shape))
        R = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        return Grasps(make(R, (ijk + 0.5) * VOXEL_SIZE)[None], np.array([0.05]), np.array([1.0]))


def camera(azimuth: float) -> Array:
    return camera_on_sphere((0.15, 0.15, 0.1), 0.6, np.deg2rad(50), azimuth)


@pytest.mark.parametrize("k", [0, 1, 2, 3])
def test_grasp_turns_with_camera_and_scene(k: int) -> None:
    grid = np.zeros((40, 40, 40), dtype=np.float32)
    grid[5, 12, 20] = 1.0
    planner = BrightestVoxel()
    at_home = plan_turned(planner, grid, camera(SIDE))
    turned = plan_turned(planner, np.rot90(grid, k, axes=(0, 1)), camera(SIDE + k * np.pi / 2 + 0.3))
    assert np.abs(turned.T_task_grasp - turn(k) @ at_home.T_task_grasp).max() < TOLERANCE
    towards = rotation_about("z", k * np.pi / 2)[:3, :3] @ [0.0, 1.0, 0.0]
    assert np.abs(turned.T_task_grasp[0, :3, 2] - towards).max() < TOLERANCE


@pytest.mark.parametrize(("azimuth", "turns"), [(-90, 0), (-50, 0), (-130, 0), (0, 3), (90, 2), (180, 1), (-180, 1)])
def test_nearest_quarter_turn(azimuth: float, turns: int) -> None:
    assert quarter_turns(SIDE, camera(np.deg2rad(azimuth))) == turns


def test_planners_without_a_side_get_the_grid_as_it_is() -> None:
    class AnySide:
        name, weights_sha256 = "any", ""

        def plan(self, grid: Grid, seed: int = 0) -> Grasps:
            return BrightestVoxel().plan(grid, seed)

    grid = np.zeros((40, 40, 40), dtype=np.float32)
    grid[5, 12, 20] = 1.0
    assert not isinstance(AnySide(), OneSided)
    seen = plan_turned(AnySide(), grid, camera(0.0)).T_task_grasp[0, :3, 3]
    assert np.abs(seen - np.array([5.5, 12.5, 20.5]) * VOXEL_SIZE).max() < TOLERANCE
