"""A Panda hand without an arm that tries grasps in physics, exactly as VGN and its successors do (spec §6.2)."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import pybullet

from evg_app.geometry import MAX_OPENING, Array, from_quaternion, invert, to_quaternion, translation
from evg_app.simulation.bullet import TIME_STEP, Client
from evg_app.simulation.hand_hulls import finger_points, hand_points
from evg_app.simulation.scenes import step

START = 0.05
"""Distance of the pre-grasp from the grasp along the approach [m]."""
STEP_LENGTH, SPEED = 0.002, 0.10
"""Linear motion: way per command [m], and speed [m/s]."""
EFFORT = 20.0
"""Force of each finger [N]."""
CLOSING_TIME = 0.5
"""[s]."""
RETREAT = 0.10
"""How far the gripper retreats [m]."""
STEEP = np.cos(np.pi / 3)
"""Approaches within 60 degrees of straight down retreat along themselves, others straight up."""
HELD_OPENING = 0.1 * MAX_OPENING
"""Opening above which closed fingers hold something [m]."""

_CONSTRAINT_FORCE = 300.0
_T_GRASP_COM = translation(0.0, 0.0, -0.022)
"""Centre of mass of the hand in the grasp frame: what the constraint drags (spec §1)."""
_FINGERS = (0, 1)


@dataclass(frozen=True)
class GraspOutcome:
    """What became of a grasp.

    Attributes:
        success: an object was held after the retreat.
        touched: something was hit on the approach.
        width: opening after the retreat [m].
        held: PyBullet id of the object held, None without success.
    """

    success: bool
    touched: bool
    width: float
    held: int | None


class FreeGripper:
    """The hand in a physics client, dragged by a constraint; its base is where it is told to be."""

    def __init__(self, client: Client, T_world_grasp: Array) -> None:
        """Load it, open, at a grasp pose (4, 4)."""
        self._client = client
        self.body = _make_body(client)
        self._constraint = client.createConstraint(
            self.body, -1, -1, -1, pybullet.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 1.0]
        )
        gear = client.createConstraint(self.body, 0, self.body, 1, pybullet.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0])
        client.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=50)
        self.place(T_world_grasp)

    def remove(self) -> None:
        """Take it out of the client."""
        self._client.removeBody(self.body)

    def place(self, T_world_grasp: Array) -> None:
        """Put it at a grasp pose (4, 4), open and at rest, without physics."""
        self._client.resetBasePositionAndOrientation(self.body, *_com(T_world_grasp))
        self._client.resetBaseVelocity(self.body, [0, 0, 0], [0, 0, 0])
        for joint in _FINGERS:
            self._client.resetJointState(self.body, joint, MAX_OPENING / 2)
        self._drag(T_world_grasp)

    def T_world_grasp(self) -> Array:
        """Where it is. Shape (4, 4)."""
        position, quaternion = self._client.getBasePositionAndOrientation(self.body)
        T: Array = from_quaternion(quaternion, position) @ invert(_T_GRASP_COM)
        return T

    def move(self, goal: Array, until_touch: bool) -> bool:
        """Drag it straight to a position (3,) [m]; whether it touches something in the end, or on the way.

        With `until_touch` it stops at the first touch.
        """
        T = self.T_world_grasp()
        way = goal - T[:3, 3]
        length = float(np.linalg.norm(way))
        count = int(length / STEP_LENGTH + 1e-6)
        for _ in range(count):
            T[:3, 3] += way / count
            self._drag(T)
            step(self._client, int(length / count / SPEED / TIME_STEP))
            if until_touch and self.touches():
                return True
        return self.touches()

    def move_fingers(self, position: float, speed: float | None = None) -> None:
        """Drive each finger to `position` [m] from now on; without `speed` [m/s] as fast as the motor goes."""
        limit = {} if speed is None else {"maxVelocity": speed}
        for joint in _FINGERS:
            self._client.setJointMotorControl2(
                self.body, joint, pybullet.POSITION_CONTROL, targetPosition=position, force=EFFORT, **limit
            )

    def close(self, speed: float | None = None) -> None:
        """Close for `CLOSING_TIME`."""
        self.move_fingers(0.0, speed)
        step(self._client, round(CLOSING_TIME / TIME_STEP))

    def opening(self) -> float:
        """Distance of the fingers [m]."""
        return float(sum(self._client.getJointState(self.body, joint)[0] for joint in _FINGERS))

    def touched_bodies(self) -> list[int]:
        """Bodies in contact, in the order of the contacts."""
        contacts = self._client.getContactPoints(self.body)
        return list(dict.fromkeys(int(c[2]) for c in contacts if c[2] != self.body))

    def touches(self) -> bool:
        """Whether anything is in contact."""
        return bool(self.touched_bodies())

    def _drag(self, T_world_grasp: Array) -> None:
        position, quaternion = _com(T_world_grasp)
        self._client.changeConstraint(self._constraint, position, quaternion, maxForce=_CONSTRAINT_FORCE)


def try_grasp(client: Client, T_world_grasp: Array, objects: Collection[int]) -> GraspOutcome:
    """Load a gripper, try one grasp (4, 4) with a touch allowed on the approach, and take the gripper away.

    `objects` are the bodies that may be held (the table may not).
    """
    before = T_world_grasp.copy()
    before[:3, 3] -= START * T_world_grasp[:3, 2]
    gripper = FreeGripper(client, before)
    touched = gripper.move(T_world_grasp[:3, 3], until_touch=True)
    gripper.close()
    gripper.move(retreat(T_world_grasp), until_touch=False)
    width = gripper.opening()
    held = [body for body in gripper.touched_bodies() if body in objects]
    gripper.remove()
    success = bool(held) and width > HELD_OPENING
    return GraspOutcome(success, touched, width, held[0] if success else None)


def retreat(T_world_grasp: Array) -> Array:
    """Where a gripper goes with what it holds [m]. Shapes (4, 4) -> (3,)."""
    steep = -T_world_grasp[2, 2] >= STEEP - 1e-9
    direction = -T_world_grasp[:3, 2] if steep else np.array([0.0, 0.0, 1.0])
    goal: Array = T_world_grasp[:3, 3] + RETREAT * direction
    return goal


def _com(T_world_grasp: Array) -> tuple[list[float], list[float]]:
    """Position and quaternion of the centre of mass, which PyBullet's poses of a body mean."""
    T = T_world_grasp @ _T_GRASP_COM
    return T[:3, 3].tolist(), to_quaternion(T).tolist()


def _make_body(client: Client) -> int:
    """Hand and two fingers as convex hulls; link frame = grasp frame, joints open along +-y."""
    shapes = [
        client.createCollisionShape(pybullet.GEOM_MESH, vertices=points.tolist())
        for points in (hand_points(), finger_points(+1, 0.0), finger_points(-1, 0.0))
    ]
    body = int(
        client.createMultiBody(
            0.81,
            shapes[0],
            -1,
            [0.0, 0.0, 1.0],
            baseInertialFramePosition=_T_GRASP_COM[:3, 3].tolist(),
            linkMasses=[0.1, 0.1],
            linkCollisionShapeIndices=shapes[1:],
            linkVisualShapeIndices=[-1, -1],
            linkPositions=[[0, 0, 0], [0, 0, 0]],
            linkOrientations=[[0, 0, 0, 1], [0, 0, 0, 1]],
            linkInertialFramePositions=[[0, 0.01, 0.03], [0, -0.01, 0.03]],
            linkInertialFrameOrientations=[[0, 0, 0, 1], [0, 0, 0, 1]],
            linkParentIndices=[0, 0],
            linkJointTypes=[pybullet.JOINT_PRISMATIC, pybullet.JOINT_PRISMATIC],
            linkJointAxis=[[0, 1, 0], [0, -1, 0]],
        )
    )
    for joint in _FINGERS:
        client.changeDynamics(
            body, joint, lateralFriction=1.0, spinningFriction=0.1, contactStiffness=3e4, contactDamping=1e3
        )
    for a, b in ((-1, 0), (-1, 1), (0, 1)):
        client.setCollisionFilterPair(body, body, a, b, 0)
    return body
