"""The scene as the planner sees it: surface points, a distance field, declared boxes and the table plane."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from evg_app.config.models import RobotConfig
from evg_app.errors import BadInput
from evg_app.geometry import TABLE_HEIGHT, Array, invert, transform_points
from evg_app.motion.field import DistanceField
from evg_app.types import Box, Capsule, CollisionVolume, TsdfGrid

Flags = NDArray[np.bool_]

TABLE_BAND = 0.006
"""Surface points up to this far above the table plane are the table's [m]: it is known analytically."""
FREE_FROM = 0.65
"""Value of the grid above which a voxel counts as free: 9 mm in front of the surface."""
SELF_PADDING = 0.02
"""Occupied voxels this close to the arm's present pose cannot be real and are dropped [m]."""


@dataclass(frozen=True)
class SceneView:
    """What the planner is given.

    Attributes:
        tsdf: the workspace cube, task frame.
        volume: the wider, coarser picture, base frame.
        boxes: declared obstacles beside those of the robot config, base frame.
    """

    tsdf: TsdfGrid
    volume: CollisionVolume
    boxes: tuple[Box, ...] = ()


@dataclass(frozen=True)
class Plane:
    """The table top: points p with normal @ p = offset, in the base frame; `normal` points up."""

    normal: Array
    offset: float

    def height(self, points: Array) -> Array:
        """Height [m] of points (..., 3) above the plane. Shape (...)."""
        height: Array = points @ self.normal - self.offset
        return height


@dataclass(frozen=True)
class Boxes:
    """Declared boxes as arrays: centres and half sides (B, 3) [m]."""

    center: Array
    half: Array

    @staticmethod
    def of(boxes: tuple[Box, ...]) -> "Boxes":
        """From values."""
        center = np.array([box.center for box in boxes], dtype=np.float64).reshape(-1, 3)
        half = np.array([box.size for box in boxes], dtype=np.float64).reshape(-1, 3) / 2
        return Boxes(center, half)

    def distance(self, points: Array) -> Array:
        """Distance [m] of points (..., 3) to the nearest box, 0 inside, infinite without boxes. Shape (...)."""
        if points.ndim == 1:
            return np.asarray(self.distance(points[None])[0])
        if len(self.center) == 0:
            return np.full(points.shape[:-1], np.inf)
        beyond = np.abs(points[..., None, :] - self.center)
        beyond -= self.half
        np.maximum(beyond, 0.0, out=beyond)
        return np.asarray(np.sqrt(np.einsum("...i,...i->...", beyond, beyond).min(axis=-1)))


@dataclass(frozen=True)
class Scene:
    """A `SceneView` prepared for checks.

    Attributes:
        points: surface points in the base frame, without the table's: sub-voxel inside the cube, voxel centres
            outside. Shape (P, 3) [m].
        field: distance to the occupied voxels, without the table's.
        boxes: declared boxes.
        table: the table plane.
        extra: declared boxes beside those of the robot config.
        known: which voxels of the cube were seen to be free, and where they are; None when nothing was seen.
        unseen: centres of voxels that count as solid because nothing saw them (conservative policy). (U, 3) [m].
        unseen_field: distance to the occupied and the unseen voxels, None where that is `field`.
    """

    points: Array
    field: DistanceField | None
    boxes: Boxes
    table: Plane
    extra: tuple[Box, ...] = ()
    known: "FreeSpace | None" = None
    unseen: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))
    unseen_field: DistanceField | None = None

    @property
    def solid(self) -> DistanceField | None:
        """Distance to everything that the arm must not enter."""
        return self.field if self.unseen_field is None else self.unseen_field

    def free(self, points: Array) -> Flags:
        """Whether points (..., 3) lie in space that was seen to be free. Shape (...)."""
        if self.known is None:
            return np.zeros(points.shape[:-1], dtype=np.bool_)
        return self.known.at(points)


@dataclass(frozen=True)
class FreeSpace:
    """Voxels of the workspace cube in front of every seen surface.

    Attributes:
        voxels: bool (N, N, N).
        voxel_size: [m].
        T_task_base: maps the base frame to the cube's. Shape (4, 4).
    """

    voxels: Flags
    voxel_size: float
    T_task_base: Array

    @staticmethod
    def of(grid: TsdfGrid, T_base_task: Array) -> "FreeSpace":
        """Observed voxels that are more than `FREE_FROM` of the band in front of a surface."""
        free = grid.observed & ((grid.values == 0) | (grid.values > FREE_FROM))
        return FreeSpace(free, grid.size / grid.values.shape[0], invert(T_base_task))

    def at(self, points: Array) -> Flags:
        """Whether points (..., 3) [m, base frame] lie in such a voxel. Shape (...)."""
        in_task = points @ self.T_task_base[:3, :3].T + self.T_task_base[:3, 3]
        index = np.floor(in_task / self.voxel_size).astype(np.intp)
        inside = ((index >= 0) & (index < self.voxels.shape[0])).all(axis=-1)
        index = np.clip(index, 0, self.voxels.shape[0] - 1)
        return np.asarray(inside & self.voxels[index[..., 0], index[..., 1], index[..., 2]])


def table_plane(robot: RobotConfig) -> Plane:
    """The table top of the lab: `TABLE_HEIGHT` above the task frame's origin (spec §1)."""
    T = robot.T_base_task.matrix()
    normal = T[:3, 2]
    return Plane(normal, float(normal @ transform_points(T, [0.0, 0.0, TABLE_HEIGHT])))


def declared_boxes(robot: RobotConfig) -> tuple[Box, ...]:
    """Obstacles and bin walls of the robot config."""
    return (*(model.box() for model in robot.obstacles), *robot.drop.walls())


def empty_scene(robot: RobotConfig) -> Scene:
    """Only what is declared: boxes and table."""
    return Scene(np.zeros((0, 3)), None, Boxes.of(declared_boxes(robot)), table_plane(robot))


def prepare(robot: RobotConfig, view: SceneView, arm: list[Capsule]) -> Scene:
    """Build the points and the distance fields; `arm` are the links where the arm is now.

    Raises:
        BadInput: a grid of the view has values that are not finite, or a shape that does not fit.
    """
    check_view(view)
    T_base_task, table = robot.T_base_task.matrix(), table_plane(robot)
    volume = view.volume
    index, centers = _solid_voxels(volume, volume.occupied, table, arm)
    occupied = np.zeros_like(volume.occupied)
    occupied[tuple(index.T)] = True
    outside = ~_in_cube(centers, T_base_task, view.tsdf.size)
    surface = transform_points(T_base_task, surface_points(view.tsdf))
    surface = surface[table.height(surface) > TABLE_BAND]
    boxes = Boxes.of((*declared_boxes(robot), *view.boxes))
    field = DistanceField(occupied, volume.origin, volume.voxel_size)
    points = np.concatenate([surface, centers[outside]])
    known = FreeSpace.of(view.tsdf, T_base_task)
    scene = Scene(points, field, boxes, table, view.boxes, known)
    if robot.unknown_space == "optimistic":
        return scene
    index, centers = _solid_voxels(volume, ~volume.observed & ~volume.occupied, table, arm)
    inside = _in_cube(centers, T_base_task, view.tsdf.size)
    lowest = table.height(centers) <= TABLE_BAND + 1.5 * volume.voxel_size
    inside[inside] = _standing(index[inside], occupied, lowest[inside])
    solid = occupied.copy()
    solid[tuple(index[inside].T)] = True
    both = DistanceField(solid, volume.origin, volume.voxel_size)
    return dataclasses.replace(scene, unseen=centers[inside], unseen_field=both)


def check_view(view: SceneView) -> None:
    """Refuse what cannot be a scene.

    Raises:
        BadInput: values that are not finite, or shapes that do not belong together.
    """
    grid, volume = view.tsdf, view.volume
    if grid.values.ndim != 3 or grid.values.shape != grid.observed.shape or len(set(grid.values.shape)) != 1:
        shapes = f"{grid.values.shape} and {grid.observed.shape}"
        raise BadInput(f"the grid must be a cube with a mask of its shape, has {shapes}; nothing was planned")
    if volume.occupied.ndim != 3 or volume.occupied.shape != volume.observed.shape or not volume.voxel_size > 0:
        shapes = f"{volume.occupied.shape} and {volume.observed.shape}, voxels of {volume.voxel_size} m"
        raise BadInput(f"the collision volume does not fit together: {shapes}; nothing was planned")
    if not (np.isfinite(grid.values).all() and np.isfinite(volume.origin).all()):
        raise BadInput("the scene holds values that are not finite; nothing was planned. Capture a new frame")


def _solid_voxels(
    volume: CollisionVolume, mask: Flags, table: Plane, arm: list[Capsule]
) -> tuple[NDArray[np.int64], Array]:
    """Indices (K, 3) and centres (K, 3) [m] of the voxels in `mask` that are neither the table's nor the arm's."""
    index = np.argwhere(mask)
    centers = volume.origin + (index + 0.5) * volume.voxel_size
    raised = table.height(centers) > TABLE_BAND + volume.voxel_size / 2
    index, centers = index[raised], centers[raised]
    real = ~_near(centers, arm)
    return index[real], centers[real]


def _standing(index: NDArray[np.int64], occupied: Flags, lowest: Flags) -> Flags:
    """Which unseen voxels hang together with the table or something seen: nothing floats in what the camera missed.

    Args:
        index: of the unseen voxels that are not the table's. Shape (U, 3).
        occupied: bool (X, Y, Z).
        lowest: whether the voxel under each is the table's. Shape (U,).
    """
    if len(index) == 0:
        return np.zeros(0, dtype=np.bool_)
    first = np.maximum(index.min(axis=0) - 1, 0)
    part = occupied[tuple(slice(a, b) for a, b in zip(first, index.max(axis=0) + 2, strict=True))]
    unseen = np.zeros(part.shape, dtype=np.bool_)
    here = tuple((index - first).T)
    unseen[here] = True
    label, _ = ndimage.label(unseen | part, structure=np.ones((3, 3, 3)))
    held_up = np.unique(np.concatenate([label[part], label[here][lowest]]))
    return np.isin(label[here], held_up)


def _in_cube(points: Array, T_base_task: Array, size: float) -> Flags:
    """Whether points (P, 3) of the base frame lie inside the workspace cube. Shape (P,)."""
    in_task = (points - T_base_task[:3, 3]) @ T_base_task[:3, :3]
    return np.asarray(((in_task >= 0) & (in_task <= size)).all(axis=1))


def surface_points(grid: TsdfGrid) -> Array:
    """Zero crossings between neighbouring voxels along the three axes, task frame. Shape (P, 3) [m].

    Only the seen surface, not the band of 3 cm behind it: a finger may go behind a thin object.
    """
    n = grid.values.shape[0]
    voxel = grid.size / n
    value = grid.values.astype(np.float64)
    points = []
    for axis in range(3):
        low, high = (np.take(value, range(k, n - 1 + k), axis=axis) for k in (0, 1))
        crosses = (low > 0) & (high > 0) & ((low > 0.5) != (high > 0.5))
        index = np.argwhere(crosses)
        a, b = low[crosses], high[crosses]
        p = (index + 0.5) * voxel
        p[:, axis] += voxel * (a - 0.5) / (a - b)
        points.append(p)
    return np.concatenate(points)


def _near(points: Array, arm: list[Capsule]) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Whether points (P, 3) lie in a padded link."""
    near = np.zeros(len(points), dtype=np.bool_)
    for link in arm:
        axis = link.p1 - link.p0
        relative = points - link.p0
        along = np.clip(relative @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
        gap = relative - along[:, None] * axis
        near |= np.einsum("ij,ij->i", gap, gap) <= (link.radius + SELF_PADDING) ** 2
    return near
