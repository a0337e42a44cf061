"""Does a grasp succeed in physics? A free-flying gripper tries it (spec §6.2), strict: no touch on approach."""

from dataclasses import dataclass

import numpy as np

from evg_app.geometry import MAX_OPENING, Array, make
from evg_app.simulation.bullet import Client, connect, load_object
from evg_app.simulation.free_gripper import START, FreeGripper, retreat
from evg_app.simulation.objects import ObjectModel
from evg_app.simulation.scenes import add_table, step
from evg_app.simulation.state import SceneObject, SceneState

CLOSING_SPEED = 0.1
"""Largest speed of each finger [m/s]; the benchmark's have none."""
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
        if self._gripper.move(T_task_grasp[:3, 3], until_touch=True):
            return Trial(True, False, MAX_OPENING)
        self._gripper.close(CLOSING_SPEED)
        self._gripper.move(retreat(T_task_grasp), until_touch=False)
        width = self._gripper.opening()
        held = any(self._between(body) for body in self._objects) and width > MIN_HELD
        return Trial(False, held, width)

    def _between(self, body: int) -> bool:
        """Whether both fingers touch it."""
        links = {c[3] for c in self._client.getContactPoints(self._gripper.body, body)}
        return {0, 1} <= links


def _load(client: Client, thing: SceneObject, masses: dict[str, float]) -> int:
    """Put one object of a scene state into physics."""
    mass = masses.get(thing.name, 0.3)
    model = ObjectModel(thing.name, thing.urdf, thing.collision_mesh, thing.visual_mesh, mass, (0.0, 0.0, 0.0))
    return load_object(client, model, thing.scale, thing.T_task_object, visible=False)
