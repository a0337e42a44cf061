"""Cover convex link meshes with a few spheres, so that a configuration is checked by distance lookups alone."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from evg_app.geometry import Array

SLACK = 0.010
"""How far a sphere may stick out of its link [m]."""
SAMPLE = 0.008
"""Largest spacing of the surface samples that must be covered [m]."""
MARGIN = 0.003
"""Samples count as covered only this deep inside a sphere [m]: the surface between samples."""


@dataclass(frozen=True)
class SphereBody:
    """Spheres fixed to the frames of `Kinematics.frames`.

    Attributes:
        frame: index of the frame each sphere moves with. Shape (S,).
        center: in that frame [m]. Shape (S, 3).
        radius: [m]. Shape (S,).
        gripper: whether it belongs to the hand or a finger. Shape (S,).
        names: the link of each sphere.
    """

    frame: Array
    center: Array
    radius: Array
    gripper: Array
    names: tuple[str, ...]

    def place(self, frames: Array) -> Array:
        """Sphere centres in the base frame. Shapes (N, 8, 4, 4) -> (N, S, 3) [m]."""
        T = frames[:, self.frame]
        placed: Array = np.einsum("nsij,sj->nsi", T[..., :3, :3], self.center) + T[..., :3, 3]
        return placed


def link_points(item: Any) -> Array:
    """Vertices of a collision mesh (Pinocchio geometry object) in its joint's frame [m]. Shape (V, 3)."""
    vertices = np.asarray(item.geometry.vertices()) * np.asarray(item.meshScale)
    placement = item.placement
    points: Array = vertices @ np.asarray(placement.rotation).T + np.asarray(placement.translation)
    return points


def surface_samples(points: Array, spacing: float = SAMPLE) -> Array:
    """Points on the convex hull of `points` (V, 3), no further apart than `spacing` [m]. Shape (P, 3)."""
    hull = ConvexHull(points)
    vertices, _ = trimesh.remesh.subdivide_to_size(points, hull.simplices, spacing)
    samples: Array = np.unique(np.round(vertices, 6), axis=0)
    return samples


def cover(points: Array, slack: float = SLACK) -> tuple[Array, Array]:
    """Spheres that cover the surface of the convex hull of `points` and stick out at most `slack` [m].

    Greedy: of spheres around interior grid points, each as large as `slack` allows, take the one that covers most
    samples that are still bare.

    Returns:
        Centres (S, 3) and radii (S,) [m].
    """
    samples = surface_samples(points)
    centers, radii = _candidates(points, slack)
    square = ((samples[None] - centers[:, None]) ** 2).sum(axis=2)
    covers = square <= ((radii - MARGIN) ** 2)[:, None]
    bare = covers.any(axis=0)
    chosen: list[int] = []
    while bare.any():
        best = int(np.argmax(covers[:, bare].sum(axis=1)))
        chosen.append(best)
        bare &= ~covers[best]
    return centers[chosen], radii[chosen]


def _candidates(points: Array, slack: float) -> tuple[Array, Array]:
    """Interior grid points of the convex hull, and the radius each may have."""
    equations = ConvexHull(points).equations
    low, high = points.min(axis=0), points.max(axis=0)
    step = np.clip((high - low).max() / 24, 0.003, 0.012)
    axes = [np.arange(a + step / 4, b, step) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    depth = -(grid @ equations[:, :3].T + equations[:, 3]).max(axis=1)
    inside = depth > 0
    return grid[inside], depth[inside] + slack


def arm_spheres(meshes: Any, gripper_links: tuple[str, ...]) -> SphereBody:
    """Sphere covers of all collision meshes of an arm but its fixed base.

    Args:
        meshes: Pinocchio geometry model.
        gripper_links: names of the hand and finger links.
    """
    frames, centers, radii, names = [], [], [], []
    for item in meshes.geometryObjects:
        if int(item.parentJoint) == 0:
            continue
        center, radius = cover(link_points(item))
        centers.append(center)
        radii.append(radius)
        frames.append(np.full(len(radius), int(item.parentJoint)))
        names += [item.name.rsplit("_", 1)[0]] * len(radius)
    gripper = np.array([name in gripper_links for name in names])
    return SphereBody(np.concatenate(frames), np.concatenate(centers), np.concatenate(radii), gripper, tuple(names))
