"""A cluttered table for one round, built and cleared as VGN's simulator does (spec §4.2, §6).

Unlike `simulation.scenes` (the product's own recipe) this follows the published protocol to the letter, so that
published numbers can be compared: masses of the URDFs as written, VGN's rule of rest, VGN's low box for piles.
"""

from collections.abc import Sequence
from types import TracebackType
from typing import Self

import numpy as np
import pybullet

from evg_app.benchmark.clutter.config import BenchmarkConfig
from evg_app.geometry import TABLE_HEIGHT, WORKSPACE_SIZE, Array, rotation_about, to_quaternion
from evg_app.simulation.bullet import TIME_STEP, body_pose, connect, pose, random_rotation, static_box
from evg_app.simulation.free_gripper import GraspOutcome, try_grasp
from evg_app.simulation.objects import ObjectModel
from evg_app.simulation.scenes import PlacedObject, step
from evg_app.simulation.state import SceneObject, SceneState

SOLVER_ITERATIONS = 150
"""Of the benchmark's physics (spec §4.2)."""
TABLE_FRICTION = 0.5
"""Lateral friction of VGN's table plane."""
REST_STEPS, REST_SPEED = 60, 0.01
"""Steps between looks, and norm of (velocity [m/s], angular velocity [rad/s]) below which a body rests."""
REST_TIME, DROP_TIME = 2.0, 1.0
"""How long resting is waited for, in general and after each drop [s]."""
MAX_ATTEMPTS = 12
"""Placements tried for a packed scene."""
BOX = (0.02, 0.28, 0.13)
"""VGN's pile box: from, to and height above the table [m]."""
DROP_HEIGHT = 0.25
"""Task height from which objects of a pile fall [m]."""
PACKED_SCALE, PILE_SCALE = (0.7, 0.9), (0.8, 1.0)
"""Ranges of the objects' scale."""


class ClutteredTable:
    """One round's physics; a fresh client, so that a round is a function of its seeds alone. Close it when done."""

    def __init__(self, config: BenchmarkConfig, objects: Sequence[ObjectModel], rng: np.random.Generator) -> None:
        """Build and settle the scene."""
        self.client = connect(solver_iterations=SOLVER_ITERATIONS)
        self._models, self._rng = objects, rng
        self.placed: list[PlacedObject] = []
        middle = WORKSPACE_SIZE / 2
        center = np.array([middle, middle, TABLE_HEIGHT - 0.05])
        static_box(self.client, np.array([1.2, 1.2, 0.1]), center, None, TABLE_FRICTION)
        if config.scene == "packed":
            self._pack(config.count)
        else:
            self._pile(config.count)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.client.disconnect()

    @property
    def objects(self) -> int:
        """How many are left."""
        return len(self.placed)

    def state(self) -> SceneState:
        """All objects as they lie now."""
        return SceneState(tuple(self._as_data(thing) for thing in self.placed))

    def execute(self, T_task_grasp: Array) -> GraspOutcome:
        """Try a grasp (4, 4), take what it held away, and let the rest settle."""
        outcome = try_grasp(self.client, T_task_grasp, [p.body for p in self.placed])
        if outcome.held is not None:
            self._remove([p for p in self.placed if p.body == outcome.held])
        self.remove_and_rest()
        return outcome

    def remove_and_rest(self) -> None:
        """Let objects settle, and take away those whose origin left the cube, until none has."""
        while True:
            self._rest(REST_TIME)
            gone = [p for p in self.placed if not self._inside(p.body)]
            self._remove(gone)
            if not gone:
                return

    def _as_data(self, thing: PlacedObject) -> SceneObject:
        m = thing.model
        T = body_pose(self.client, thing.body)
        return SceneObject(m.name, m.urdf, m.collision_mesh, m.visual_mesh, thing.scale, T, m.compound)

    def _inside(self, body: int) -> bool:
        position = np.array(self.client.getBasePositionAndOrientation(body)[0])
        return bool((position >= 0.0).all() and (position <= WORKSPACE_SIZE).all())

    def _remove(self, things: list[PlacedObject]) -> None:
        for thing in things:
            self.client.removeBody(thing.body)
            self.placed.remove(thing)

    def _rest(self, seconds: float) -> None:
        for _ in range(int(np.ceil(seconds / (REST_STEPS * TIME_STEP)))):
            step(self.client, REST_STEPS)
            if all(self._speed(p.body) <= REST_SPEED for p in self.placed):
                return

    def _speed(self, body: int) -> float:
        linear, angular = self.client.getBaseVelocity(body)
        return float(np.linalg.norm([*linear, *angular]))

    def _load(self, model: ObjectModel, scale: float, T_task_com: Array) -> PlacedObject:
        """Load an object with its centre of mass (for VGN's objects also its link frame) at a pose (4, 4)."""
        body = int(self.client.loadURDF(str(model.urdf), globalScaling=scale, flags=pybullet.URDF_IGNORE_VISUAL_SHAPES))
        self._put(body, T_task_com)
        return PlacedObject(model, body, scale)

    def _put(self, body: int, T_task_com: Array) -> None:
        self.client.resetBasePositionAndOrientation(
            body, T_task_com[:3, 3].tolist(), to_quaternion(T_task_com).tolist()
        )

    def _draw(self, scale_range: tuple[float, float]) -> tuple[ObjectModel, float]:
        model = self._models[int(self._rng.integers(len(self._models)))]
        return model, float(self._rng.uniform(*scale_range))

    def _pile(self, count: int) -> None:
        walls = self._box()
        for _ in range(count):
            model, scale = self._draw(PILE_SCALE)
            x, y = self._rng.uniform(WORKSPACE_SIZE / 3, 2 * WORKSPACE_SIZE / 3, 2)
            self.placed.append(self._load(model, scale, pose(random_rotation(self._rng), x, y, DROP_HEIGHT)))
            self._rest(DROP_TIME)
        for wall in walls:
            self.client.removeBody(wall)
        self.remove_and_rest()

    def _box(self) -> list[int]:
        low, high, height = BOX
        middle, span, thick = (low + high) / 2, high - low, 0.02
        walls = []
        for axis in (0, 1):
            for edge in (low - thick / 2, high + thick / 2):
                center = np.array([middle, middle, TABLE_HEIGHT + height / 2])
                size = np.array([span + 2 * thick, span + 2 * thick, height])
                center[axis], size[axis] = edge, thick
                walls.append(static_box(self.client, size, center, None, TABLE_FRICTION))
        return walls

    def _pack(self, count: int) -> None:
        for _ in range(MAX_ATTEMPTS):
            if self.objects >= count:
                return
            before = self.client.saveState()
            thing = self._stand()
            step(self.client, 1)
            if self.client.getContactPoints(thing.body):
                self.client.removeBody(thing.body)
                self.client.restoreState(before)
            else:
                self.placed.append(thing)
                self.remove_and_rest()
            self.client.removeState(before)

    def _stand(self) -> PlacedObject:
        """One object upright, 2 mm above the table, wherever the draw puts it.

        VGN takes the centre of mass for the middle of the object's height, and so do folders' objects here.
        """
        model, scale = self._draw(PACKED_SCALE)
        x, y = self._rng.uniform(0.08, 0.22, 2)
        R = rotation_about("z", float(self._rng.uniform(0.0, 2.0 * np.pi)))[:3, :3]
        thing = self._load(model, scale, pose(R, x, y, 1.0))
        low, high = self.client.getAABB(thing.body)
        below = 0.5 * (high[2] - low[2]) if model.family == "folder" else 1.0 - low[2]
        self._put(thing.body, pose(R, x, y, TABLE_HEIGHT + below + 0.002))
        return thing
