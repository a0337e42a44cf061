"""Random grasps at seen surface: the floor of every comparison."""

import numpy as np

from evg_app.geometry import FINGER_DEPTH, Array, make
from evg_app.grasping.protocol import Grid, grid_values
from evg_app.grasping.surface import surface_points
from evg_app.types import Grasps

MAX_TILT = np.pi / 3
"""Largest angle between approach and straight down [rad]."""
INSERT = 0.025
"""How far the finger tips go past the surface point [m]."""


class RandomPlanner:
    """Random approach from above at random object points, random score."""

    name = "random"
    weights_sha256 = ""

    def __init__(self, count: int = 64) -> None:
        self.count = count

    def plan(self, grid: Grid, seed: int = 0) -> Grasps:
        """Up to `count` grasps in random order; see `Planner.plan`."""
        objects = surface_points(grid_values(grid)).on_objects()
        if len(objects.points) == 0:
            return Grasps.empty()
        rng = np.random.default_rng(abs(seed))
        points = objects.points[rng.integers(len(objects.points), size=self.count)]
        R = _from_above(rng, self.count)
        T = make(R, points - R[:, :, 2] * (FINGER_DEPTH - INSERT))
        return Grasps(T, np.full(self.count, 0.05), np.sort(rng.uniform(size=self.count))[::-1].copy())


def _from_above(rng: np.random.Generator, count: int) -> Array:
    """Rotations whose approach lies uniformly within `MAX_TILT` of straight down, any yaw. Shape (N, 3, 3)."""
    z = -rng.uniform(np.cos(MAX_TILT), 1.0, count)
    azimuth, yaw = rng.uniform(0, 2 * np.pi, (2, count))
    s = np.sqrt(1.0 - z**2)
    approach = np.stack([s * np.cos(azimuth), s * np.sin(azimuth), z], axis=1)
    a = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(count)], axis=1)
    b = np.cross(approach, a)
    y = np.cos(yaw)[:, None] * a + np.sin(yaw)[:, None] * b
    return np.stack([np.cross(y, approach), y, approach], axis=2)
