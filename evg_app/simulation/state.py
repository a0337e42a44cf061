"""A settled scene as plain data: labels, occupancy and pictures are computed from it without physics."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import TABLE_HEIGHT, Array, invert, transform_points
from evg_app.simulation.meshes import Mesh, half_spaces, load_parts, merged


@dataclass(frozen=True)
class SceneObject:
    """One object at rest.

    Attributes:
        name: of its model.
        urdf, collision_mesh, visual_mesh: its files.
        scale: factor on the meshes.
        T_task_object: where it lies; mesh vertices v map to T @ (scale * v). Shape (4, 4).
        compound: the collision mesh's groups are exactly its convex parts.
    """

    name: str
    urdf: Path
    collision_mesh: Path
    visual_mesh: Path
    scale: float
    T_task_object: Array
    compound: bool

    def parts(self) -> Iterator[Mesh]:
        """Its collision parts in the task frame (convex where `compound`, and in physics their hulls) [m]."""
        for part in load_parts(self.collision_mesh):
            yield Mesh(transform_points(self.T_task_object, self.scale * part.vertices), part.faces)

    def visual(self) -> Mesh:
        """Its visual mesh in the task frame [m]."""
        mesh = merged(load_parts(self.visual_mesh))
        return Mesh(transform_points(self.T_task_object, self.scale * mesh.vertices), mesh.faces)

    def contains(self, points: Array, margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether task-frame points [m] are inside its body (union of its parts' hulls), grown by `margin` [m].

        `points` has shape (N, 3); the answer has shape (N,).
        """
        local = transform_points(invert(self.T_task_object), points) / self.scale
        inside = np.zeros(len(local), dtype=np.bool_)
        for planes in half_spaces(self.collision_mesh):
            rest = np.flatnonzero(~inside)
            distance = local[rest] @ planes[:, :3].T + planes[:, 3]
            inside[rest] = distance.max(axis=1, initial=-np.inf) <= margin / self.scale
        return inside


@dataclass(frozen=True)
class SceneState:
    """Objects at rest on the table, in the task frame.

    Attributes:
        objects: in order of placement.
        table_height: top of the table [m].
    """

    objects: tuple[SceneObject, ...]
    table_height: float = TABLE_HEIGHT

    def occupied(self, points: Array) -> NDArray[np.bool_]:
        """Whether task-frame points [m] are inside any object (the table does not count). Shapes (N, 3) -> (N,)."""
        inside = np.zeros(len(points), dtype=np.bool_)
        for thing in self.objects:
            near = thing.T_task_object[:3, 3]
            reach = thing.scale * float(np.linalg.norm(merged(load_parts(thing.collision_mesh)).vertices, axis=1).max())
            close = np.flatnonzero(~inside & (((points - near) ** 2).sum(axis=1) <= reach**2))
            inside[close] = thing.contains(points[close])
        return inside
