"""What the loop, the benchmark and foreign harnesses need of a grasp planner."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evg_app.errors import BadInput
from evg_app.geometry import GRID_SIZE
from evg_app.types import Grasps, TsdfGrid

Grid = TsdfGrid | NDArray[np.float32]
"""A fused grid, or its bare values: float (40, 40, 40) in the convention of spec §1."""


class Planner(Protocol):
    """Plans grasps on a grid of the workspace."""

    @property
    def name(self) -> str:
        """The model's name, as `load_planner` knows it."""

    @property
    def weights_sha256(self) -> str:
        """Hash of the weights file, empty for planners without one."""

    def plan(self, grid: Grid, seed: int = 0) -> Grasps:
        """Ranked grasps, best first; the same for the same grid and seed.

        Raises:
            BadInput: the grid has another shape or is not finite.
        """


def grid_values(grid: Grid) -> NDArray[np.float32]:
    """The values of a grid, checked. Shape (40, 40, 40).

    Raises:
        BadInput: another shape, a value that is not finite or lies outside [0, 1].
    """
    values = np.asarray(grid.values if isinstance(grid, TsdfGrid) else grid)
    if values.shape != (GRID_SIZE,) * 3:
        raise BadInput(f"the planner's grid has shape {values.shape}; it must be {(GRID_SIZE,) * 3}, index (x, y, z)")
    low, high = float(values.min()), float(values.max())
    if not (low >= 0.0 and high <= 1.0):  # also catches nan
        raise BadInput(
            f"grid values run from {low:g} to {high:g}; they must be TSDF values in [0, 1], 0 = unknown or far"
        )
    return np.ascontiguousarray(values, dtype=np.float32)
