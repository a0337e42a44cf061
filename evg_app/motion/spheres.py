"""Cover convex link meshes with a few spheres, so that a configuration is checked by distance lookups alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.distance import cdist

from evg_app.errors import BadInput
from evg_app.geometry import Array
from evg_app.motion.kinematics import Primitive

SLACK = 0.015
"""How far a sphere may stick out of its link [m]."""
GRIPPER_SLACK = 0.011
"""The same for the hand and the fingers [m]."""
SAMPLE = 0.015
"""Largest spacing of the surface samples that must be covered [m]."""
MARGIN = 0.003
"""Samples count as covered only this deep inside a sphere [m]: the surface between samples."""


CORNERS: Array = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), dtype=np.float64).reshape(3, -1).T
"""Corners of the cube of side 2. Shape (8, 3)."""


@dataclass(frozen=True)
class SphereBody:
    """Spheres fixed to the frames of `Kinematics.frames`.

    Attributes:
        frame: index of the frame each sphere moves with. Shape (S,).
        center: in that frame [m]. Shape (S, 3).
        radius: [m]. Shape (S,).
        gripper: whether it belongs to the hand or a finger. Shape (S,).
        names: the link of each sphere.
        corner_frame, corner: corners of a box around everything that a frame carries. Shapes (B,), (B, 3) [m].
    """

    frame: NDArray[np.int64]
    center: Array
    radius: Array
    gripper: NDArray[np.bool_]
    names: tuple[str, ...]
    corner_frame: NDArray[np.int64]
    corner: Array

    def moved(self, frames: Array) -> Array:
        """How far any point of the arm moves at most between neighbours of frames (N, 8, 4, 4). Shape (N - 1,) [m].

        A rigid motion moves the points of a box no further than its corners.
        """
        T = frames[:, self.corner_frame]
        p = (T[..., :3, :3] @ self.corner[:, :, None])[..., 0] + T[..., :3, 3]
        step = np.diff(p, axis=0)
        return np.asarray(np.sqrt(np.einsum("nbi,nbi->nb", step, step).max(axis=1, initial=0.0)))

    def place(self, frames: Array) -> Array:
        """Sphere centres in the base frame. Shapes (N, 8, 4, 4) -> (N, S, 3) [m]."""
        placed = np.empty((len(frames), len(self.radius), 3))
        for j, part in self._parts:
            placed[:, part] = self.center[part] @ frames[:, j, :3, :3].transpose(0, 2, 1) + frames[:, j, None, :3, 3]
        return placed

    @property
    def _parts(self) -> list[tuple[int, slice]]:
        """Frames in use, and their run of spheres (`frame` ascends)."""
        used, start = np.unique(self.frame, return_index=True)
        ends = [*start[1:].tolist(), len(self.frame)]
        return [(int(j), slice(int(a), int(b))) for j, a, b in zip(used, start, ends, strict=True)]


def link_points(item: Any) -> Array:
    """Points whose convex hull is a collision geometry, in its joint's frame [m]. Shape (V, 3).

    Raises:
        BadInput: it is neither a mesh nor a box.
    """
    if hasattr(item.geometry, "halfSide"):
        vertices = CORNERS * np.asarray(item.geometry.halfSide)
    elif hasattr(item.geometry, "vertices"):
        vertices = np.asarray(item.geometry.vertices()) * np.asarray(item.meshScale)
    else:
        kind = type(item.geometry).__name__
        raise BadInput(f"collision geometry of '{item.name}' is a {kind}; use meshes or boxes in the robot's URDF")
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
    covers = cdist(centers, samples) <= (radii - MARGIN)[:, None]
    bare = covers.any(axis=0)
    gain = covers.sum(axis=1)
    chosen: list[int] = []
    while bare.any():
        best = int(np.argmax(gain))
        chosen.append(best)
        new = covers[best] & bare
        gain -= covers[:, new].sum(axis=1)
        bare &= ~new
    return centers[chosen], radii[chosen]


@lru_cache(maxsize=64)
def _cover_of(points: bytes, slack: float) -> tuple[Array, Array]:
    """`cover`, once for every link of a process."""
    center, radius = cover(np.frombuffer(points, dtype=np.float64).reshape(-1, 3), slack)
    center.setflags(write=False)
    radius.setflags(write=False)
    return center, radius


def _candidates(points: Array, slack: float) -> tuple[Array, Array]:
    """Interior grid points of the convex hull, and the radius each may have."""
    equations = ConvexHull(points).equations
    low, high = points.min(axis=0), points.max(axis=0)
    step = np.clip((high - low).min() / 6, 0.003, 0.016)
    axes = [np.arange(a + step / 4, b, step) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    depth = -(grid @ equations[:, :3].T + equations[:, 3]).max(axis=1)
    inside = depth > 0
    return grid[inside], depth[inside] + slack


def arm_spheres(meshes: Any, gripper_links: tuple[str, ...], attached: Sequence[Primitive] = ()) -> SphereBody:
    """Sphere covers of all collision meshes of an arm but its fixed base, and of declared bodies on it.

    Args:
        meshes: Pinocchio geometry model.
        gripper_links: names of the hand and finger links.
        attached: capsules fixed to the moving frames; they count as the arm's, not the gripper's.
    """
    covers: list[tuple[int, str, Array, Array]] = []
    corners: list[tuple[int, Array]] = []
    for (frame, name), points in _points_by_link(meshes).items():
        slack = GRIPPER_SLACK if name in gripper_links else SLACK
        covers.append((frame, name, *_cover_of(np.ascontiguousarray(points).tobytes(), slack)))
        corners.append((frame, points))
    for name, frame, p0, p1, radius in attached:
        if frame > 0:
            covers.append((frame, name, *_capsule_spheres(p0, p1, radius)))
            corners.append((frame, np.concatenate([p0 + radius * CORNERS, p1 + radius * CORNERS])))
    covers.sort(key=lambda item: item[0])
    frames, names, centers, radii = zip(*covers, strict=True)
    counts = [len(radius) for radius in radii]
    each = tuple(name for name, count in zip(names, counts, strict=True) for _ in range(count))
    gripper = np.array([name in gripper_links for name in each])
    corner_frame, corner = _box_corners(corners)
    return SphereBody(
        np.repeat(frames, counts), np.concatenate(centers), np.concatenate(radii), gripper, each, corner_frame, corner
    )


def _capsule_spheres(p0: Array, p1: Array, radius: float) -> tuple[Array, Array]:
    """Spheres that hold a capsule: centres (S, 3) and radii (S,) [m]."""
    count = int(np.ceil(np.linalg.norm(p1 - p0) / radius)) + 1
    centers = p0 + np.linspace(0.0, 1.0, count)[:, None] * (p1 - p0)
    gap = float(np.linalg.norm(p1 - p0)) / max(count - 1, 1)
    return centers, np.full(count, float(np.hypot(radius, gap / 2)))


def _box_corners(points: list[tuple[int, Array]]) -> tuple[NDArray[np.int64], Array]:
    """For each frame the corners of a box around all its points: frame (8 F,), corner (8 F, 3)."""
    frames = sorted({frame for frame, _ in points})
    boxes = []
    for frame in frames:
        own = np.concatenate([p for k, p in points if k == frame])
        low, high = own.min(axis=0), own.max(axis=0)
        boxes.append((low + high) / 2 + CORNERS * (high - low) / 2)
    return np.repeat(frames, 8), np.concatenate(boxes)


def _points_by_link(meshes: Any) -> dict[tuple[int, str], Array]:
    """Hull points of every moving link, in order of the frame it moves with."""
    points: dict[tuple[int, str], Array] = {}
    for item in sorted(meshes.geometryObjects, key=lambda g: int(g.parentJoint)):
        key = (int(item.parentJoint), str(item.name).rsplit("_", 1)[0])
        if key[0] > 0:
            points[key] = np.concatenate([points.get(key, np.zeros((0, 3))), link_points(item)])
    return points
