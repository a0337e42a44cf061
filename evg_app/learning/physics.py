"""Does a grasp succeed in physics? A free-flying gripper tries it (spec §6.2), strict: no touch on approach."""

from dataclasses import dataclass

import numpy as np
import pybullet

from evg_app.geometry import MAX_OPENING, Array, make, to_quaternion
from evg_app.learning.gripper import finger_points, hand_points
from evg_app.simulation.bullet import TIME_STEP, Client, connect, load_object
from evg_app.simulation.objects import ObjectModel
from evg_app.simulation.scenes import add_table, step
from evg_app.simulation.state import SceneObject, SceneState

START = 0.05
"""Distance of the pre-grasp from the grasp along the approach [m] (spec §6.2)."""
STEP_LENGTH, STEPS_EACH = 0.002, 4
"""Linear motion: way per command [m] and physics steps per command."""
EFFORT, SPEED = 20.0, 0.1
"""Force [N] and largest speed [m/s] of each finger."""
LIFT = 0.10
"""How far the gripper retreats [m]."""
SOLVER_ITERATIONS = 200
"""With 50, objects below about 40 g are flung out of perfect grips (83 % of 110 positives held; with 200, 98.6 %)."""
MIN_HELD = 0.003
"""Opening above which closed fingers hold something [m]."""


@dataclass(frozen=True)
class Trial:
    """What happened.

    Attributes:
        touched: something was hit on the approach.
        held: an object was between the fingers after the lift.
        width: opening after the lift [m].
    """

    touched: bool
    held: bool
    width: float


class TrialBench:
    """Tries grasps in one settled scene; the scene is restored before every trial. Close it when done."""

    def __init__(self, state: SceneState, masses: dict[str, float] | None = None) -> None:
        self._client = connect(solver_iterations=SOLVER_ITERATIONS)
        add_table(self._client, np.eye(4))
        self._objects = [_load(self._client, thing, masses or {}) for thing in state.objects]
        self._gripper = _make_gripper(self._client)
        self._constraint = self._client.createConstraint(
            self._gripper, -1, -1, -1, pybullet.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 1.0]
        )
        gear = self._client.createConstraint(
            self._gripper, 0, self._gripper, 1, pybullet.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0]
        )
        self._client.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=50)
        self._place(make(np.eye(3), [0.0, 0.0, 1.0]))
        step(self._client, 1)
        self._start = self._client.saveState()

    def close(self) -> None:
        """Free the physics client; safe to call twice."""
        self._client.disconnect()

    def __call__(self, T_task_grasp: Array) -> Trial:
        """Try one grasp (4, 4)."""
        self._client.restoreState(self._start)
        before = T_task_grasp.copy()
        before[:3, 3] -= START * T_task_grasp[:3, 2]
        self._place(before)
        touched = self._move(before, T_task_grasp, until_touch=True)
        if touched:
            return Trial(True, False, MAX_OPENING)
        self._fingers(0.0)
        step(self._client, round(0.5 / TIME_STEP))
        away = T_task_grasp.copy()
        steep = T_task_grasp[2, 2] < -0.5
        away[:3, 3] += LIFT * (-T_task_grasp[:3, 2] if steep else np.array([0.0, 0.0, 1.0]))
        self._move(T_task_grasp, away, until_touch=False)
        width = float(sum(self._client.getJointState(self._gripper, j)[0] for j in (0, 1)))
        held = any(self._touches(b) for b in self._objects) and width > MIN_HELD
        return Trial(False, held, width)

    def _touches(self, body: int) -> bool:
        sides = {c[3] for c in self._client.getContactPoints(self._gripper, body)}
        return {0, 1} <= sides

    def _place(self, T: Array) -> None:
        q = to_quaternion(T).tolist()
        self._client.resetBasePositionAndOrientation(self._gripper, T[:3, 3].tolist(), q)
        self._client.resetBaseVelocity(self._gripper, [0, 0, 0], [0, 0, 0])
        for joint in (0, 1):
            self._client.resetJointState(self._gripper, joint, MAX_OPENING / 2)
        self._client.changeConstraint(self._constraint, T[:3, 3].tolist(), q, maxForce=300)
        self._fingers(MAX_OPENING / 2)

    def _fingers(self, position: float) -> None:
        for joint in (0, 1):
            self._client.setJointMotorControl2(
                self._gripper,
                joint,
                pybullet.POSITION_CONTROL,
                targetPosition=position,
                force=EFFORT,
                maxVelocity=SPEED,
            )

    def _move(self, start: Array, goal: Array, until_touch: bool) -> bool:
        """Straight line; whether something other than the gripper itself was touched (checked while moving)."""
        way = goal[:3, 3] - start[:3, 3]
        count = max(1, int(np.linalg.norm(way) / STEP_LENGTH))
        q = to_quaternion(goal).tolist()
        for k in range(1, count + 1):
            target = (start[:3, 3] + way * k / count).tolist()
            self._client.changeConstraint(self._constraint, target, q, maxForce=300)
            step(self._client, STEPS_EACH)
            if until_touch and any(c[2] != self._gripper for c in self._client.getContactPoints(self._gripper)):
                return True
        return False


def _load(client: Client, thing: SceneObject, masses: dict[str, float]) -> int:
    """Put one object of a scene state into physics."""
    mass = masses.get(thing.name, 0.3)
    model = ObjectModel(thing.name, thing.urdf, thing.collision_mesh, thing.visual_mesh, mass, (0.0, 0.0, 0.0))
    return load_object(client, model, thing.scale, thing.T_task_object, visible=False)


def _make_gripper(client: Client) -> int:
    """Hand and two fingers as convex hulls; base frame = grasp frame, joints open along +-y."""
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
    for joint in (0, 1):
        client.changeDynamics(
            body, joint, lateralFriction=1.0, spinningFriction=0.1, contactStiffness=3e4, contactDamping=1e3
        )
    for a, b in ((-1, 0), (-1, 1), (0, 1)):
        client.setCollisionFilterPair(body, body, a, b, 0)
    return body
