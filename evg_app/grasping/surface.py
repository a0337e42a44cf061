"""Points and normals of the seen surface, read off the TSDF grid, for the planners that learn nothing."""

from dataclasses import dataclass

import numpy as np

from evg_app.geometry import TABLE_HEIGHT, VOXEL_SIZE, Array
from evg_app.grasping.selection import Mask, Volume, surface

TRUNCATION = 4 * VOXEL_SIZE
"""The grid's truncation distance [m] (spec §1)."""
ABOVE_TABLE = TABLE_HEIGHT + 0.010
"""From this height up [m] a surface point is taken for an object's."""


@dataclass(frozen=True)
class SurfacePoints:
    """Seen surface.

    Attributes:
        points: task frame [m]. Shape (N, 3).
        normals: outward unit vectors. Shape (N, 3).
    """

    points: Array
    normals: Array

    def on_objects(self) -> "SurfacePoints":
        """Those clearly above the table."""
        high = self.points[:, 2] > ABOVE_TABLE
        return SurfacePoints(self.points[high], self.normals[high])


def surface_points(values: Volume) -> SurfacePoints:
    """Points at f = 0 near voxel centres of the grid (40, 40, 40), with the gradient's direction as normal."""
    where = surface(values, min_z=0.0, thickness=0.6)
    gradient = np.stack([_difference(values, where, axis) for axis in range(3)], axis=1)
    length = np.linalg.norm(gradient, axis=1)
    good = length > 1e-3
    normals = gradient[good] / length[good, None]
    centres = (np.argwhere(where)[good] + 0.5) * VOXEL_SIZE
    distance = (2.0 * values[where][good].astype(np.float64) - 1.0) * TRUNCATION
    return SurfacePoints(centres - distance[:, None] * normals, normals)


def _difference(values: Volume, where: Mask, axis: int) -> Array:
    """Derivative along one axis at the voxels `where`, from neighbours inside the band only. Shape (N,)."""
    padded = np.pad(values, [(1, 1) if a == axis else (0, 0) for a in range(3)]).astype(np.float64)
    n = values.shape[axis]
    behind = np.take(padded, np.arange(0, n), axis=axis)[where]
    ahead = np.take(padded, np.arange(2, n + 2), axis=axis)[where]
    here = values[where].astype(np.float64)
    forward = np.where(ahead > 0, ahead - here, 0.0)
    backward = np.where(behind > 0, here - behind, 0.0)
    sides = (ahead > 0).astype(np.float64) + (behind > 0)
    slope: Array = (forward + backward) / np.maximum(sides, 1.0)
    return slope
