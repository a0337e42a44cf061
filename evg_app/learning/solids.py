"""A scene's objects as the labels see them: convex solids in the task frame, with rays and clearances."""

from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from evg_app.geometry import TABLE_HEIGHT, Array
from evg_app.learning.gripper import swept_bodies

SWEEP = 0.08
"""Length of the straight approach that must be free [m]."""
CLOSE = 0.0005
"""Clearance below which the approach counts as a collision [m] (learning.md: contacts are certain there)."""
FREE = 0.0035
"""Clearance from which on the approach counts as free [m]; between the two nothing is labelled."""


@dataclass(frozen=True)
class Solid:
    """One convex piece of an object.

    Attributes:
        owner: index of the object in the scene.
        vertices: in the task frame [m]. Shape (V, 3).
        faces: triangles, outward. Shape (F, 3).
    """

    owner: int
    vertices: Array
    faces: NDArray[np.int64]


@dataclass(frozen=True)
class Hits:
    """First surface that each ray meets.

    Attributes:
        distance: [m], inf where the ray meets nothing. Shape (N,).
        owner: object index, -1 for none. Shape (N,).
        normal: unit normal of the face met (sign arbitrary). Shape (N, 3).
    """

    distance: Array
    owner: NDArray[np.int64]
    normal: Array


class SceneSolids:
    """Rays against, and gripper clearances to, the objects of one settled scene and its table."""

    def __init__(self, solids: list[Solid]) -> None:
        self.solids = solids
        self._rays = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._owner_of = np.full(len(solids) + 1, -1, dtype=np.int64)
        for i, solid in enumerate(solids):
            self._rays.add_triangles(_tensor(solid.vertices, np.float32), _tensor(solid.faces, np.uint32))
            self._owner_of[i] = solid.owner
        self._convex = [_convex(solid.vertices) for solid in solids]
        self._low = np.array([s.vertices.min(axis=0) for s in solids]).reshape(-1, 3)
        self._high = np.array([s.vertices.max(axis=0) for s in solids]).reshape(-1, 3)
        self._bodies = [(points, _convex(points)) for points in swept_bodies(SWEEP)]

    def cast(self, origins: Array, directions: Array) -> Hits:
        """First hits of rays from `origins` [m] along unit `directions`. Shapes (N, 3)."""
        rays = np.concatenate([origins, directions], axis=1)
        answer = self._rays.cast_rays(_tensor(rays, np.float32), nthreads=1)
        geometry = answer["geometry_ids"].numpy().astype(np.int64)
        geometry = np.where(geometry >= len(self.solids), len(self.solids), geometry)
        return Hits(
            answer["t_hit"].numpy().astype(np.float64),
            self._owner_of[geometry],
            answer["primitive_normals"].numpy().astype(np.float64),
        )

    def clearance(self, T_task_grasp: Array) -> Array:
        """Smallest distance [m] of the open gripper, swept over the approach, to objects and table; <= 0 touches.

        Exact up to `FREE`; larger distances may be returned as inf, and a touching pose stops at its first contact.
        Shapes (N, 4, 4) -> (N,).
        """
        result = np.full(len(T_task_grasp), np.inf)
        rotation, position = T_task_grasp[:, :3, :3], T_task_grasp[:, :3, 3]
        for points, convex in self._bodies:
            corners = points @ np.swapaxes(rotation, 1, 2) + position[:, None, :]
            result = np.minimum(result, corners[:, :, 2].min(axis=1) - TABLE_HEIGHT)
            low, high = corners.min(axis=1) - FREE, corners.max(axis=1) + FREE
            near = ((low[:, None] <= self._high) & (high[:, None] >= self._low)).all(axis=2)
            near &= (result > CLOSE)[:, None]
            self._measure(convex, near, rotation, position, result)
        return result

    def _measure(
        self, body: coal.ConvexBase, near: NDArray[np.bool_], rotation: Array, position: Array, result: Array
    ) -> None:
        """Lower `result` (N,) in place by the distances of one body to the pieces marked in `near` (N, pieces)."""
        request, answer, identity = coal.DistanceRequest(), coal.DistanceResult(), coal.Transform3s()
        for i in np.flatnonzero(near.any(axis=1)):
            pose = coal.Transform3s(rotation[i], position[i])
            for j in np.flatnonzero(near[i]):
                answer.clear()
                distance = coal.distance(body, pose, self._convex[j], identity, request, answer)
                result[i] = min(result[i], distance)
                if result[i] <= CLOSE:
                    break


def _tensor(a: NDArray[Any], dtype: type) -> Any:
    """An Open3D tensor (Open3D's stubs know no numpy)."""
    tensor: Any = o3d.core.Tensor
    return tensor(np.ascontiguousarray(a, dtype=dtype))


def _convex(points: Array) -> coal.ConvexBase:
    """The convex hull of points (N, 3) as a coal shape."""
    vertices = coal.StdVec_Vec3s()
    for point in np.asarray(points, dtype=np.float64):
        vertices.append(point)
    return coal.Convex.convexHull(vertices, False, "Qt")
