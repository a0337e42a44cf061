"""A thin door to PyBullet: clients, poses, static boxes and object bodies."""

import functools
from typing import Any

import numpy as np
import pybullet

from evg_app.geometry import Array, from_quaternion, invert, make, to_quaternion
from evg_app.simulation.objects import ObjectModel

TIME_STEP = 1.0 / 240.0
"""Fixed physics step [s]."""
GRAVITY = 9.81
"""[m/s^2], along -z."""


class Client:
    """One physics client: `client.stepSimulation()` is `pybullet.stepSimulation(physicsClientId=...)`."""

    def __init__(self, gui: bool = False) -> None:
        self.number = int(pybullet.connect(pybullet.GUI if gui else pybullet.DIRECT))

    def __getattr__(self, name: str) -> Any:
        bound = functools.partial(getattr(pybullet, name), physicsClientId=self.number)
        setattr(self, name, bound)
        return bound

    def disconnect(self) -> None:
        """Free the client; safe to call twice."""
        if self.number >= 0 and pybullet.isConnected(self.number):
            pybullet.disconnect(self.number)
        self.number = -1


def connect(gui: bool = False, solver_iterations: int = 50, ordered_pairs: bool = True) -> Client:
    """A fresh physics client with gravity, the fixed step and nothing in it; `disconnect()` it when done.

    `ordered_pairs` sorts contacts so that a long-lived client is reproducible; a client used once is so anyway.
    """
    client = Client(gui)
    client.setPhysicsEngineParameter(fixedTimeStep=TIME_STEP, numSolverIterations=solver_iterations)
    client.setPhysicsEngineParameter(deterministicOverlappingPairs=int(ordered_pairs))
    client.setGravity(0, 0, -GRAVITY)
    return client


def static_box(client: Client, size: Array, center: Array, color: tuple[float, ...] | None, friction: float) -> int:
    """An immovable axis-aligned box with full side lengths `size` [m]; drawn only if it has a colour. Its body id."""
    half = (np.asarray(size) / 2.0).tolist()
    shape = client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half)
    visual = -1 if color is None else client.createVisualShape(pybullet.GEOM_BOX, halfExtents=half, rgbaColor=color)
    body = int(client.createMultiBody(0.0, shape, visual, np.asarray(center, dtype=np.float64).tolist()))
    client.changeDynamics(body, -1, lateralFriction=friction)
    return body


def load_object(client: Client, model: ObjectModel, scale: float, T_world_object: Array, visible: bool) -> int:
    """Load one object with its link frame at `T_world_object`; its body id. Without visuals it loads faster."""
    flags = 0 if visible else pybullet.URDF_IGNORE_VISUAL_SHAPES
    body = int(
        client.loadURDF(
            str(model.urdf),
            basePosition=T_world_object[:3, 3].tolist(),
            baseOrientation=to_quaternion(T_world_object).tolist(),
            globalScaling=scale,
            flags=flags,
        )
    )
    mass = model.mass * scale**3
    if abs(float(client.getDynamicsInfo(body, -1)[0]) - mass) > 1e-6:
        client.changeDynamics(body, -1, mass=mass)
    return body


def body_pose(client: Client, body: int) -> Array:
    """T_world_object of a body's base LINK frame (PyBullet itself tells the centre of mass). Shape (4, 4)."""
    position, quaternion = client.getBasePositionAndOrientation(body)
    T_world_com = from_quaternion(quaternion, position)
    info = client.getDynamicsInfo(body, -1)
    return T_world_com @ invert(from_quaternion(info[4], info[3]))


def random_rotation(rng: np.random.Generator) -> Array:
    """A uniformly random rotation. Shape (3, 3)."""
    R: Array = from_quaternion(rng.normal(size=4))[:3, :3]
    return R


def pose(R: Array, x: float, y: float, z: float) -> Array:
    """Transform from a rotation and a position [m]. Shape (4, 4)."""
    return make(R, [x, y, z])
