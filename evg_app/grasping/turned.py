"""Planners that only know one side to look from: the grid is turned to it, the grasps are turned back."""

from typing import Protocol, runtime_checkable

import numpy as np

from evg_app.geometry import WORKSPACE_SIZE, Array, invert, rotation_about, translation
from evg_app.grasping.protocol import Grid, Planner, grid_values
from evg_app.types import Grasps


@runtime_checkable
class OneSided(Protocol):
    """A planner trained on views from one side."""

    @property
    def training_azimuth(self) -> float:
        """Azimuth of the camera in training, about the workspace's centre [rad]."""


def plan_turned(planner: Planner, grid: Grid, T_task_cam: Array, seed: int = 0) -> Grasps:
    """The planner's grasps; the grid of a `OneSided` planner is turned by k quarter turns to its side first.

    Args:
        grid: as `Planner.plan` takes it.
        T_task_cam: where the grid's camera was. Shape (4, 4).
    """
    turns = quarter_turns(planner.training_azimuth, T_task_cam) if isinstance(planner, OneSided) else 0
    if turns == 0:
        return planner.plan(grid, seed)
    values = np.ascontiguousarray(np.rot90(grid_values(grid), turns, axes=(0, 1)))
    grasps = planner.plan(values, seed)
    return Grasps(invert(turn(turns)) @ grasps.T_task_grasp, grasps.width, grasps.score)


def quarter_turns(azimuth: float, T_task_cam: Array) -> int:
    """How many quarter turns (0 to 3) of the scene bring the camera nearest to `azimuth` [rad]."""
    x, y = T_task_cam[:2, 3] - WORKSPACE_SIZE / 2
    return round((azimuth - float(np.arctan2(y, x))) / (np.pi / 2)) % 4


def turn(turns: int) -> Array:
    """The scene's turn by `turns` quarter turns about the workspace's vertical axis. Shape (4, 4)."""
    c = WORKSPACE_SIZE / 2
    T: Array = translation(c, c, 0.0) @ rotation_about("z", turns * np.pi / 2) @ translation(-c, -c, 0.0)
    return T
