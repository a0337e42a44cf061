"""Points on and in a scene's solids: surface samples for grasp candidates, occupancy samples for the network."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from evg_app.geometry import WORKSPACE_SIZE, Array
from evg_app.learning.solids import Solid

INSIDE_MARGIN = 1e-4
"""A surface point deeper than this inside another solid is not on the outer surface [m]."""
NEAR_SURFACE = 0.006
"""Standard deviation of occupancy samples near a surface [m]."""


@dataclass(frozen=True)
class SurfacePoints:
    """Points on the outer surface of a scene.

    Attributes:
        position: [m]. Shape (N, 3).
        normal: outward unit normals. Shape (N, 3).
        owner: object index. Shape (N,).
    """

    position: Array
    normal: Array
    owner: NDArray[np.int64]

    def take(self, index: NDArray[np.int64]) -> "SurfacePoints":
        """The points at `index`, in that order."""
        return SurfacePoints(self.position[index], self.normal[index], self.owner[index])


def half_spaces(solids: list[Solid]) -> list[Array]:
    """Half spaces (n, d) of each solid: inside where n.p + d <= 0. Shapes (F_i, 4)."""
    return [np.asarray(ConvexHull(solid.vertices).equations) for solid in solids]


def depth_inside(points: Array, planes: list[Array]) -> Array:
    """Per point (N, 3) and solid, how deep it is inside [m], negative outside (a lower bound). Shape (N, S)."""
    return np.stack([-(points @ p[:, :3].T + p[:, 3]).max(axis=1) for p in planes], axis=1)


def sample_surface(solids: list[Solid], planes: list[Array], count: int, rng: np.random.Generator) -> SurfacePoints:
    """About `count` points on the outer surface, the same number for every object, upward and side faces preferred."""
    owners = np.array([s.owner for s in solids])
    chunks = []
    for owner in np.unique(owners):
        mine = [solids[i] for i in np.flatnonzero(owners == owner)]
        chunks.append(_sample_object(mine, count // len(np.unique(owners)), int(owner), rng))
    points = SurfacePoints(
        np.concatenate([c.position for c in chunks]),
        np.concatenate([c.normal for c in chunks]),
        np.concatenate([c.owner for c in chunks]),
    )
    outer = depth_inside(points.position, planes).max(axis=1) < INSIDE_MARGIN
    return points.take(np.flatnonzero(outer))


def _sample_object(solids: list[Solid], count: int, owner: int, rng: np.random.Generator) -> SurfacePoints:
    """`count` points on one object's solids by area, weighted for usefulness as a contact."""
    corners = np.concatenate([s.vertices[s.faces] for s in solids])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    normal = cross / np.maximum(area, 1e-12)[:, None]
    usefulness = np.where(normal[:, 2] < -0.7, 0.1, np.where(normal[:, 2] > 0.7, 0.4, 1.0))
    weight = area * usefulness
    face = rng.choice(len(corners), size=count, p=weight / weight.sum())
    u, v = rng.random((2, count))
    over = u + v > 1
    u, v = np.where(over, 1 - u, u)[:, None], np.where(over, 1 - v, v)[:, None]
    a, b, c = (corners[face, k] for k in range(3))
    position = a + u * (b - a) + v * (c - a)
    return SurfacePoints(position, normal[face], np.full(count, owner))


def sample_occupancy(
    surface: SurfacePoints, planes: list[Array], count: int, rng: np.random.Generator
) -> tuple[NDArray[np.float16], NDArray[np.bool_]]:
    """Points (N, 3) [m] and whether they lie in an object: 70 % uniform in the cube, 30 % near surfaces (spec §0.9)."""
    uniform = rng.random((count - round(0.3 * count), 3)) * WORKSPACE_SIZE
    index = rng.integers(len(surface.position), size=count - len(uniform))
    near = surface.position[index] + rng.normal(scale=NEAR_SURFACE, size=(len(index), 3))
    points = np.clip(np.concatenate([uniform, near]), 0.0, WORKSPACE_SIZE).astype(np.float16)
    inside = depth_inside(points.astype(np.float64), planes).max(axis=1) > 0
    return points, inside
