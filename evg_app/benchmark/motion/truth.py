"""What a perfect observer sees of a scene: the planner's own input, made from meshes and poses instead of depth."""

from typing import Any

import numpy as np
import open3d as o3d
from numpy.typing import NDArray
from scipy import ndimage

from evg_app.geometry import TABLE_HEIGHT, WORKSPACE_SIZE, Array, transform_points
from evg_app.learning.generate import solids_of
from evg_app.learning.solids import Solid
from evg_app.motion.scene import SceneView
from evg_app.perception.tsdf import BAND, TRUNCATION
from evg_app.perception.volume import VOLUME_SIZE, volume_origin
from evg_app.simulation.state import SceneState
from evg_app.types import CollisionVolume, TsdfGrid

GRID = 60
"""Voxels of the true grid along one side: 5 mm each."""
VOXEL = 0.00625
"""Side of the true collision volume's voxels [m]: half of the observed one's."""
NEAR = 0.03
"""The collision volume is evaluated this far around the objects [m]."""


def true_view(state: SceneState, T_base_task: Array) -> SceneView:
    """The scene as the planner takes it, without noise, occlusion or unknown space.

    Args:
        state: objects in the task frame, as physics collides with them.
        T_base_task: shape (4, 4).
    """
    distance = TrueDistance(state)
    return SceneView(_grid(distance), _volume(distance, T_base_task))


class TrueDistance:
    """Signed distance to the convex pieces that physics collides with, task frame."""

    def __init__(self, state: SceneState) -> None:
        """For the objects of a scene."""
        self._state = state
        self._solids: list[Solid] = solids_of(state)
        self._rays = o3d.t.geometry.RaycastingScene(nthreads=1)
        for solid in self._solids:
            self._rays.add_triangles(_tensor(solid.vertices, np.float32), _tensor(solid.faces, np.uint32))

    def at(self, points: Array) -> Array:
        """Distance [m] of points (N, 3) to the nearest object, negative inside; the table does not count. (N,)."""
        distance = self._rays.compute_distance(_tensor(points, np.float32), nthreads=1).numpy().astype(np.float64)
        near = np.flatnonzero(distance < NEAR + TRUNCATION)
        inside = np.zeros(len(points), dtype=np.bool_)
        inside[near] = self._state.occupied(points[near])
        signed: Array = np.where(inside, -distance, distance)
        return signed

    def corners(self) -> tuple[Array, Array]:
        """Lowest and highest coordinates of all objects [m]. Shape (3,) each."""
        vertices = np.concatenate([solid.vertices for solid in self._solids])
        return vertices.min(axis=0), vertices.max(axis=0)


def _grid(distance: TrueDistance) -> TsdfGrid:
    """The workspace cube as a TSDF."""
    axis = (np.arange(GRID) + 0.5) * WORKSPACE_SIZE / GRID
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    f = np.minimum(distance.at(points), points[:, 2] - TABLE_HEIGHT) / TRUNCATION
    values = np.where((f >= -BAND) & (f < BAND), (f + 1) / 2, 0.0).astype(np.float32)
    shape = (GRID, GRID, GRID)
    return TsdfGrid(values.reshape(shape), (f > -1.0).reshape(shape))


def _volume(distance: TrueDistance, T_base_task: Array) -> CollisionVolume:
    """The outermost voxels of every object are occupied, as a camera all around would have it."""
    origin, n = volume_origin(T_base_task), round(VOLUME_SIZE / VOXEL)
    occupied, observed = np.zeros((n, n, n), dtype=np.bool_), np.ones((n, n, n), dtype=np.bool_)
    low, high = (transform_points(T_base_task, corner) for corner in distance.corners())
    first = np.clip(np.floor((low - NEAR - origin) / VOXEL).astype(int), 0, n)
    last = np.clip(np.ceil((high + NEAR - origin) / VOXEL).astype(int), 0, n)
    index = np.stack(np.meshgrid(*(np.arange(a, b) for a, b in zip(first, last, strict=True)), indexing="ij"), axis=-1)
    centers = origin + (index.reshape(-1, 3) + 0.5) * VOXEL
    signed = distance.at((centers - T_base_task[:3, 3]) @ T_base_task[:3, :3]).reshape(index.shape[:3])
    block = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    body = signed <= VOXEL / 2
    occupied[block] = body & ~ndimage.binary_erosion(body)
    observed[block] = occupied[block] | ~body
    return CollisionVolume(occupied, observed, origin, VOXEL)


def _tensor(a: NDArray[Any], dtype: type) -> Any:
    """An Open3D tensor (Open3D's stubs know no numpy)."""
    tensor: Any = o3d.core.Tensor
    return tensor(np.ascontiguousarray(a, dtype=dtype))
