"""Does a grasp succeed in physics? A free-flying gripper tries it (spec §6.2) in a scene that is restored each time."""

from dataclasses import dataclass

import numpy as np
import pybullet

from evg_app.geometry import MAX_OPENING, Array, make, to_quaternion
from evg_app.learning.labels import Kind
from evg_app.simulation.bullet import Client, connect
from evg_app.simulation.free_gripper import START, FreeGripper, retreat
from evg_app.simulation.scenes import add_table, step
from evg_app.simulation.state import SceneObject, SceneState

CLOSING_SPEED = 0.1
"""Largest speed of each finger [m/s]; the benchmark's have none."""
SOLVER_ITERATIONS = 200
"""With 50, objects below about 40 g are flung out of perfect grips (83 % of 110 positives held; with 200, 98.6 %)."""
APPROACH_ITERATIONS = 50
"""Enough while nothing is held."""
MIN_HELD = 0.003
"""Opening above which closed fingers hold something [m]."""


@dataclass(frozen=True)
class Trial:
    """What happened.

    Attributes:
        touched: something was hit on the approach; the fingers then closed where it stopped.
        held: an object was between the fingers after the lift.
        width: opening after the lift [m].
    """

    touched: bool
    held: bool
    width: float

    @property
    def kind(self) -> Kind:
        """What the grasp is when no touch is allowed."""
        return Kind.COLLISION if self.touched else Kind.POSITIVE if self.held else Kind.SLIP


class TrialBench:
    """Tries grasps in one settled scene; the scene is restored before every trial. Close it when done."""

    def __init__(self, state: SceneState) -> None:
        self._client = connect(solver_iterations=SOLVER_ITERATIONS)
        add_table(self._client, np.eye(4))
        self._objects = [_load(self._client, thing) for thing in state.objects]
        self._gripper = FreeGripper(self._client, make(np.eye(3), [0.0, 0.0, 1.0]))
        self._gripper.move_fingers(MAX_OPENING / 2, CLOSING_SPEED)
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
        self._gripper.place(before)
        self._gripper.move_fingers(MAX_OPENING / 2, CLOSING_SPEED)
        self._client.setPhysicsEngineParameter(numSolverIterations=APPROACH_ITERATIONS)
        touched = self._gripper.move(T_task_grasp[:3, 3], until_touch=True)
        self._client.setPhysicsEngineParameter(numSolverIterations=SOLVER_ITERATIONS)
        self._gripper.close(CLOSING_SPEED)
        if self._gripper.opening() <= MIN_HELD:
            return Trial(touched, False, self._gripper.opening())
        self._gripper.move(retreat(T_task_grasp), until_touch=False)
        width = self._gripper.opening()
        held = any(self._between(body) for body in self._objects) and width > MIN_HELD
        return Trial(touched, held, width)

    def _between(self, body: int) -> bool:
        """Whether both fingers touch it."""
        links = {c[3] for c in self._client.getContactPoints(self._gripper.body, body)}
        return {0, 1} <= links


def _load(client: Client, thing: SceneObject) -> int:
    """Put one object of a scene state into physics, with the mass its URDF says (as the benchmark does)."""
    return int(
        client.loadURDF(
            str(thing.urdf),
            basePosition=thing.T_task_object[:3, 3].tolist(),
            baseOrientation=to_quaternion(thing.T_task_object).tolist(),
            globalScaling=thing.scale,
            flags=pybullet.URDF_IGNORE_VISUAL_SHAPES,
        )
    )
