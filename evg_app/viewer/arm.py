"""The arm as it is drawn: the URDF's collision meshes (small, and what motion is checked with) at joint positions."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import trimesh
from numpy.typing import NDArray

from evg_app.config.models import RobotConfig
from evg_app.config.robot_files import resolve
from evg_app.geometry import Array
from evg_app.motion.kinematics import load_arm


class ArmMeshes:
    """The links of one arm, fingers open.

    Attributes:
        names: of the parts.
        meshes: vertices (V, 3) [m] and faces (F, 3) of each, in its own frame.

    Raises:
        BadInput: the URDF or a mesh cannot be read.
    """

    def __init__(self, robot: RobotConfig) -> None:
        self._model, self._geometry = load_arm(robot, resolve(robot.urdf))
        self._data, self._placed = self._model.createData(), self._geometry.createData()
        self._hand = self._model.getFrameId(robot.model_hand_link)
        parts = list(self._geometry.geometryObjects)
        self.names = tuple(str(part.name) for part in parts)
        self.meshes = tuple(_mesh(part) for part in parts)

    def poses(self, q: Array) -> Array:
        """Where the parts are in the base frame at q [rad]. Shapes (J,) -> (P, 4, 4)."""
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._placed, np.asarray(q, np.float64))
        return np.stack([np.asarray(placed.homogeneous) for placed in self._placed.oMg])

    def tool_path(self, path: Array) -> Array:
        """Origins of the hand along joint positions. Shapes (M, J) -> (M, 3) [m]."""
        points = np.zeros((len(path), 3))
        for i, q in enumerate(path):
            pin.forwardKinematics(self._model, self._data, np.asarray(q, np.float64))
            points[i] = pin.updateFramePlacement(self._model, self._data, self._hand).translation
        return points


def _mesh(part: Any) -> tuple[Array, NDArray[np.int64]]:
    """A part's triangles, from its file or from its primitive shape."""
    if Path(part.meshPath).is_file():
        mesh = trimesh.load(part.meshPath, force="mesh")
        mesh.apply_scale(np.asarray(part.meshScale))
    else:
        shape = part.geometry
        if hasattr(shape, "halfSide"):
            mesh = trimesh.creation.box(2 * np.asarray(shape.halfSide))
        elif hasattr(shape, "halfLength"):
            mesh = trimesh.creation.capsule(2 * shape.halfLength, shape.radius)
            mesh.apply_translation([0, 0, -shape.halfLength])
        else:
            mesh = trimesh.creation.icosphere(radius=getattr(shape, "radius", 0.01))
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
