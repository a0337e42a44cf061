"""Self-collision (coal on the primitive model) and arm against scene (spheres against a distance field)."""

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from evg_app.config.models import RobotConfig
from evg_app.config.robot_files import collision_urdf, resolve
from evg_app.geometry import Array
from evg_app.motion.kinematics import Flags, Kinematics, load_arm, primitives
from evg_app.motion.links import LinkCapsules
from evg_app.motion.scene import Scene
from evg_app.motion.spheres import SphereBody

FIELD_MARGIN = 0.004
"""Clearance of every sphere from the centre of an occupied voxel, beyond its radius [m]."""
BOX_MARGIN = 0.005
"""Clearance from declared boxes [m]."""
TABLE_MARGIN = 0.005
"""Clearance of links 2 to 7 from the table plane [m]."""
FREE_FRAMES = 2
"""Frames below this (base and link 1) stand on the table and are not checked against it."""


class SelfCollision:
    """The primitive collision model as capsules, with the pairs that the SRDF leaves on.

    Each cylinder with a sphere at both ends is one capsule: 13 bodies for the Panda's 39 primitives.
    """

    def __init__(self, robot: RobotConfig) -> None:
        """Load the model.

        Raises:
            BadInput: URDF or SRDF are missing or do not fit the config.
        """
        self._model, whole = load_arm(robot, collision_urdf(resolve(robot.urdf)))
        whole.addAllCollisionPairs()
        pin.removeCollisionPairs(self._model, whole, str(resolve(robot.srdf)))
        names = [_link(item.name) for item in whole.geometryObjects]
        allowed = {frozenset((names[p.first], names[p.second])) for p in whole.collisionPairs}
        self._geometry = pin.GeometryModel()
        capsules = primitives(robot)
        bodies = [self._geometry.addGeometryObject(_capsule(*body)) for body in capsules]
        declared = {body.name for body in robot.attached}
        for i, j in combinations(bodies, 2):
            pair = frozenset((capsules[i][0], capsules[j][0]))
            moves_apart = capsules[i][1] != capsules[j][1]
            if len(pair) == 2 and (pair in allowed or (pair & declared and moves_apart)):
                self._geometry.addCollisionPair(pin.CollisionPair(i, j))
        self._data, self._geometry_data = self._model.createData(), self._geometry.createData()

    def pairs(self) -> set[frozenset[str]]:
        """The pairs of links that are checked."""
        names = [_link(item.name) for item in self._geometry.geometryObjects]
        return {frozenset((names[p.first], names[p.second])) for p in self._geometry.collisionPairs}

    def collides(self, q: Array) -> bool:
        """Whether the arm touches itself at q (7,)."""
        return bool(pin.computeCollisions(self._model, self._data, self._geometry, self._geometry_data, q, True))

    def what_collides(self, q: Array) -> str:
        """The first pair of links in contact at q (7,), in words; empty when there is none."""
        pin.computeCollisions(self._model, self._data, self._geometry, self._geometry_data, q, False)
        for pair, result in zip(self._geometry.collisionPairs, self._geometry_data.collisionResults, strict=True):
            if result.isCollision():
                names = (self._geometry.geometryObjects[k].name for k in (pair.first, pair.second))
                return " and ".join(_link(name) for name in names)
        return ""

    def any_collides(self, q: Array) -> bool:
        """Whether any of the configurations (N, 7) collides."""
        return any(self.collides(row) for row in q)


def _link(geometry_name: str) -> str:
    """The link that a geometry belongs to."""
    return geometry_name.rsplit("_", 1)[0]


def _capsule(name: str, frame: int, p0: Array, p1: Array, radius: float) -> Any:
    """A coal capsule between two points of a joint's frame."""
    axis = p1 - p0
    length = float(np.linalg.norm(axis))
    z = axis / length if length > 0 else np.array([0.0, 0.0, 1.0])
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    placement = pin.SE3(np.stack([x, np.cross(z, x), z], axis=1), (p0 + p1) / 2)
    shape = coal.Capsule(radius, length)
    return pin.GeometryObject(f"{name}_{p0[2]:.3f}", frame, placement, shape)


@dataclass(frozen=True)
class _Link:
    """The run of spheres of one link, and a sphere around them all in the link's frame."""

    spheres: slice
    frame: int
    center: Array
    radius: float
    gripper: bool
    on_table: bool


class ArmChecker:
    """Arm and open gripper against a prepared scene, many configurations at once.

    A link's spheres are looked at only where the sphere around the whole link comes near something.
    """

    def __init__(self, kinematics: Kinematics, body: SphereBody, self_collision: SelfCollision) -> None:
        """From a body of spheres and the self-collision model."""
        self.kinematics, self.body, self.self_collision = kinematics, body, self_collision
        self.links = LinkCapsules.of(kinematics.primitives)
        self._links = _links(body)
        self._around = np.stack([link.center for link in self._links])
        self._around_frame = np.array([link.frame for link in self._links])
        self._around_on_table = np.array([link.on_table for link in self._links])
        self._on_table = body.frame < FREE_FRAMES
        self._around_radius = np.array([link.radius for link in self._links])
        self._around_gripper = np.array([link.gripper for link in self._links])
        self._spheres_of = _padded([link.spheres for link in self._links])

    def centers(self, q: Array) -> Array:
        """Sphere centres in the base frame. Shapes (N, 7) -> (N, S, 3) [m]."""
        return self.body.place(self.kinematics.frames(q))

    def hits_scene(self, q: Array, scene: Scene, gripper: bool = True, radius: Array | None = None) -> Flags:
        """Which configurations (N, 7) touch table, declared boxes or the scene's voxels. Shape (N,).

        Args:
            q: shape (N, 7).
            scene: prepared scene.
            gripper: whether hand and fingers are checked too; on the last leg they are checked more finely.
            radius: replaces the spheres' own radii [m]. Shape (S,).
        """
        return self.hits_at(self.kinematics.frames(q), scene, gripper, radius)

    def hits_at(self, frames: Array, scene: Scene, gripper: bool = True, radius: Array | None = None) -> Flags:
        """`hits_scene` for frames (N, 8, 4, 4) of configurations. Shape (N,)."""
        radius = self.body.radius if radius is None else radius
        hits = np.zeros(len(frames), dtype=np.bool_)
        placed = frames[:, self._around_frame]
        middle = (placed[..., :3, :3] @ self._around[:, :, None])[..., 0] + placed[..., :3, 3]
        near = _clearance(middle, scene, self._around_on_table) < self._around_radius
        if not gripper:
            near &= ~self._around_gripper
        row, link = np.nonzero(near)
        spheres, T = self._spheres_of[link], placed[row, link]
        centers = self.body.center[spheres] @ T[:, :3, :3].swapaxes(1, 2) + T[:, None, :3, 3]
        inside = _clearance(centers, scene, self._on_table[spheres]) < radius[spheres]
        hits[row[inside.any(axis=1)]] = True
        return hits

    def clearance(self, q: Array, scene: Scene) -> Array:
        """Distance [m] of every sphere's centre at q (7,) to whatever is nearest, margins taken off. Shape (S,)."""
        return _clearance(self.centers(q[None])[0], scene, self._on_table)

    def what_is_hit(self, q: Array, scene: Scene) -> str:
        """Which link at q (7,) touches what, in words."""
        worst = int(np.argmax(self.body.radius - self.clearance(q, scene)))
        point = self.centers(q[None])[0, worst]
        distances = {
            "a declared box": float(scene.boxes.distance(point)) - BOX_MARGIN,
            "the table": float(scene.table.height(point)) - TABLE_MARGIN,
            "the observed scene": float(scene.field.at(point)) - FIELD_MARGIN if scene.field is not None else np.inf,
            "unseen space": float(scene.solid.at(point)) - FIELD_MARGIN if scene.solid is not None else np.inf,
        }
        return f"{min(distances, key=lambda name: distances[name])} with {self.body.names[worst]}"


def _clearance(p: Array, scene: Scene, on_table: Flags | np.bool_) -> Array:
    """Distance [m] of points (..., S, 3) to the scene, margins taken off; `on_table` (S,) ones may touch the table."""
    clearance = scene.boxes.distance(p) - BOX_MARGIN
    if scene.solid is not None:
        np.minimum(clearance, scene.solid.at(p) - FIELD_MARGIN, out=clearance)
    table = np.where(on_table, np.inf, scene.table.height(p) - TABLE_MARGIN)
    return np.minimum(clearance, table)


def _padded(runs: list[slice]) -> NDArray[np.intp]:
    """Runs of indices as rows of one array (L, most): the last index of a shorter one is repeated."""
    last = np.array([run.stop - 1 for run in runs])
    offset = np.arange(max(run.stop - run.start for run in runs))
    padded: NDArray[np.intp] = np.minimum(np.array([run.start for run in runs])[:, None] + offset, last[:, None])
    return padded


def _links(body: SphereBody) -> list[_Link]:
    """The runs of spheres of each link."""
    links = []
    for name in dict.fromkeys(body.names):
        rows = np.flatnonzero(np.array(body.names) == name)
        part = slice(int(rows[0]), int(rows[-1]) + 1)
        center = (body.center[part].min(axis=0) + body.center[part].max(axis=0)) / 2
        radius = float((np.linalg.norm(body.center[part] - center, axis=1) + body.radius[part]).max())
        frame = int(body.frame[rows[0]])
        links.append(_Link(part, frame, center, radius, bool(body.gripper[rows[0]]), frame < FREE_FRAMES))
    return links
