"""Self-collision (coal on the primitive model) and arm against scene (spheres against a distance field)."""

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from evg_app.config.models import RobotConfig
from evg_app.config.robot_files import collision_urdf, resolve
from evg_app.geometry import Array
from evg_app.motion.kinematics import Kinematics, load_arm
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

Flags = NDArray[np.bool_]


class SelfCollision:
    """The primitive collision model with the pairs that the SRDF leaves on."""

    def __init__(self, robot: RobotConfig) -> None:
        """Load the model.

        Raises:
            BadInput: URDF or SRDF are missing or do not fit the config.
        """
        self._model, self._geometry = load_arm(robot, collision_urdf(resolve(robot.urdf)))
        self._geometry.addAllCollisionPairs()
        pin.removeCollisionPairs(self._model, self._geometry, str(resolve(robot.srdf)))
        self._data, self._geometry_data = self._model.createData(), self._geometry.createData()

    def pairs(self) -> list[tuple[str, str]]:
        """Names of the geometry pairs that are checked."""
        objects = self._geometry.geometryObjects
        return [(objects[p.first].name, objects[p.second].name) for p in self._geometry.collisionPairs]

    def collides(self, q: Array) -> bool:
        """Whether the arm touches itself at q (7,)."""
        return bool(pin.computeCollisions(self._model, self._data, self._geometry, self._geometry_data, q, True))

    def any_collides(self, q: Array) -> bool:
        """Whether any of the configurations (N, 7) collides."""
        return any(self.collides(row) for row in q)


class ArmChecker:
    """Arm and open gripper against a prepared scene, many configurations at once."""

    def __init__(self, kinematics: Kinematics, body: SphereBody, self_collision: SelfCollision) -> None:
        self.kinematics, self.body, self.self_collision = kinematics, body, self_collision
        self._above_base = body.frame >= FREE_FRAMES

    def centers(self, q: Array) -> Array:
        """Sphere centres in the base frame. Shapes (N, 7) -> (N, S, 3) [m]."""
        return self.body.place(self.kinematics.frames(q))

    def hits_scene(self, q: Array, scene: Scene, gripper: bool = True) -> Flags:
        """Which configurations (N, 7) touch table, declared boxes or observed voxels. Shape (N,).

        Args:
            q: shape (N, 7).
            scene: prepared scene.
            gripper: whether hand and fingers are checked too; on the last leg they are checked more finely.
        """
        return self.centers_hit(self.centers(q), scene, gripper)

    def centers_hit(self, centers: Array, scene: Scene, gripper: bool = True, radius: Array | None = None) -> Flags:
        """Like `hits_scene` for sphere centres (N, S, 3); `radius` (S,) [m] replaces the spheres' own."""
        radius = self.body.radius if radius is None else radius
        if gripper:
            return np.asarray((self.clearance(centers, scene) < radius).any(axis=1))
        arm = ~self.body.gripper
        return np.asarray((self._clearance(centers[:, arm], scene, self._above_base[arm]) < radius[arm]).any(axis=1))

    def clearance(self, centers: Array, scene: Scene) -> Array:
        """Distance [m] of sphere centres (N, S, 3) to whatever is nearest, margins taken off. Shape (N, S)."""
        return self._clearance(centers, scene, self._above_base)

    def _clearance(self, p: Array, scene: Scene, above_base: Flags) -> Array:
        clearance = scene.boxes.distance(p) - BOX_MARGIN
        if scene.field is not None:
            np.minimum(clearance, scene.field.at(p) - FIELD_MARGIN, out=clearance)
        table = np.where(above_base, scene.table.height(p) - TABLE_MARGIN, np.inf)
        return np.minimum(clearance, table)

    def what_is_hit(self, q: Array, scene: Scene) -> str:
        """Which link at q (7,) touches what, in words."""
        p = self.centers(q[None])
        excess = self.body.radius - self.clearance(p, scene)[0]
        worst = int(np.argmax(excess))
        point = p[0, worst]
        distances = {
            "a declared box": float(scene.boxes.distance(point)) - BOX_MARGIN,
            "the table": float(scene.table.height(point)) - TABLE_MARGIN,
            "the observed scene": float(scene.field.at(point)) - FIELD_MARGIN if scene.field is not None else np.inf,
        }
        return f"{min(distances, key=lambda name: distances[name])} with {self.body.names[worst]}"
