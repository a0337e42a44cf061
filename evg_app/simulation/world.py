"""The live world: table, robot, bin, declared boxes and one scene, on a fixed time step.

The base frame is PyBullet's world frame. A round starts from an empty client, so that it is a function of its seed
alone; nothing is reset or moved by hand while it lasts.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from evg_app.clock import WallClock
from evg_app.config.models import RobotConfig, WorldConfig
from evg_app.geometry import Array, from_quaternion, transform_points
from evg_app.simulation.bullet import GRAVITY, TIME_STEP, Client, connect, static_box
from evg_app.simulation.objects import ObjectModel
from evg_app.simulation.panda import RobotBody, load_robot
from evg_app.simulation.scenes import PlacedObject, SceneRecipe, add_table, build_scene, inside_cube, snapshot
from evg_app.simulation.state import SceneState

SOLVER_ITERATIONS, HOLDING_ITERATIONS = 50, 150
"""Solver iterations of a step; more while the gripper holds, since only friction holds (with 50, 3 of 10 slip out)."""
TABLE_HALF_SIZE = 0.9
"""Half side of the live table, so that the robot and the bin stand on it too [m]."""


@dataclass(frozen=True)
class Truth:
    """Where the round's objects really are, by name; what only a simulator can know.

    Attributes:
        on_table: inside the workspace cube.
        in_bin: inside the bin.
        lost: anywhere else, in the hand on the way included.
    """

    on_table: tuple[str, ...]
    in_bin: tuple[str, ...]
    lost: tuple[str, ...]


class SimWorld:
    """The physics of one lab. Devices register with `before_step`; everything else only looks."""

    def __init__(
        self,
        robot: RobotConfig,
        world: WorldConfig,
        objects: Sequence[ObjectModel],
        gui: bool = False,
        speed: float | None = None,
    ) -> None:
        """Make the world with its robot and no scene; call `new_round`.

        `speed` paces it at that factor of real time; None runs as fast as it can (real time with `gui`).
        """
        self.robot_config, self.world_config, self.objects = robot, world, tuple(objects)
        self.T_base_task = robot.T_base_task.matrix()
        self.gui, self.speed = gui, (speed if speed is not None else (1.0 if gui else None))
        self.before_step: list[Callable[[], None]] = []
        self.on_reset: list[Callable[[], None]] = []
        self.steps, self.seed = 0, 0
        self.placed: list[PlacedObject] = []
        self._wall, self._pace = WallClock(), 0.0
        self.client: Client = connect(gui, SOLVER_ITERATIONS)
        self.robot: RobotBody = self._furnish()

    @property
    def time(self) -> float:
        """Simulated time since the world was made; it goes on across rounds [s]."""
        return self.steps * TIME_STEP

    def _furnish(self) -> RobotBody:
        client = self.client
        client.resetSimulation()
        client.setPhysicsEngineParameter(
            fixedTimeStep=TIME_STEP, numSolverIterations=SOLVER_ITERATIONS, deterministicOverlappingPairs=1
        )
        client.setGravity(0, 0, -GRAVITY)
        add_table(client, self.T_base_task, TABLE_HALF_SIZE)
        for box in self.robot_config.drop.walls():
            static_box(client, np.array(box.size), np.array(box.center), (0.30, 0.45, 0.62, 1.0), 0.6)
        for model in self.robot_config.obstacles:
            static_box(client, np.array(model.size_m), np.array(model.center_m), (0.25, 0.25, 0.28, 1.0), 0.6)
        return load_robot(client, self.robot_config, detailed=self.gui)

    def recipe(self) -> SceneRecipe:
        """The scene recipe of this world's config."""
        config = self.world_config
        return SceneRecipe(config.kind, config.count, (config.scale_min, config.scale_max))

    def new_round(self, seed: int) -> int:
        """Clear everything, put the arm at its look pose, build the scene of `seed`; how many objects it has.

        Raises:
            BadInput: no object fits the scene's kind.
            SceneError: nothing at rest came out of several attempts.
        """
        self.placed, self.seed = [], seed
        self.robot = self._furnish()
        for renew in self.on_reset:
            renew()
        rng = np.random.default_rng(seed)
        self.placed = build_scene(self.client, self.recipe(), self.objects, rng, self.T_base_task)
        return len(self.placed)

    def step(self, count: int = 1) -> None:
        """Let `count` time steps pass; devices act before each."""
        for _ in range(count):
            for act in self.before_step:
                act()
            self.client.stepSimulation()
            self.steps += 1
            if self.speed is not None:
                self._keep_pace(TIME_STEP / self.speed)

    def _keep_pace(self, seconds: float) -> None:
        """Wait until this step is due; a long pause in between is not made up for."""
        now = self._wall.now()
        self._pace = max(self._pace + seconds, now - 0.02)
        if self._pace > now + 0.005:
            self._wall.sleep(self._pace - now)

    def step_until(self, when: float) -> None:
        """Step until the simulated time is at least `when` [s]."""
        self.step(max(0, int(np.ceil((when - self.time) / TIME_STEP - 1e-9))))

    def scene(self) -> SceneState:
        """All objects as they lie now, in the task frame."""
        return snapshot(self.client, self.placed, self.T_base_task)

    def truth(self) -> Truth:
        """Where every object is now. Names are made unique by the order of placement."""
        table: list[str] = []
        in_bin: list[str] = []
        lost: list[str] = []
        for number, thing in enumerate(self.placed):
            T_task_object = thing.T_task_object(self.client, self.T_base_task)
            name = f"{number}:{thing.model.name}"
            p_base = transform_points(self.T_base_task, T_task_object[:3, 3])
            where = in_bin if self._inside_bin(p_base) else table if inside_cube(T_task_object) else lost
            where.append(name)
        return Truth(tuple(table), tuple(in_bin), tuple(lost))

    def _inside_bin(self, p_base: Array) -> bool:
        drop = self.robot_config.drop
        offset = np.abs(p_base - np.array(drop.bin_center_m) - [0.0, 0.0, drop.bin_size_m[2] / 2])
        return bool((offset <= np.array(drop.bin_size_m) / 2 + [0.0, 0.0, 0.03]).all())

    def T_base_hand(self) -> Array:
        """Where the hand link is. Shape (4, 4)."""
        state = self.client.getLinkState(self.robot.body, self.robot.hand, computeForwardKinematics=1)
        return from_quaternion(state[5], state[4])

    def solve_finely(self, holding: bool) -> None:
        """Spend HOLDING_ITERATIONS on every step from now on, or SOLVER_ITERATIONS again."""
        iterations = HOLDING_ITERATIONS if holding else SOLVER_ITERATIONS
        self.client.setPhysicsEngineParameter(numSolverIterations=iterations)

    def close(self) -> None:
        """Free the physics client; safe to call twice."""
        self.client.disconnect()


class SimClock:
    """The world's own time: sleeping steps it."""

    def __init__(self, world: SimWorld) -> None:
        self._world = world

    def now(self) -> float:
        """Simulated time [s]."""
        return self._world.time

    def sleep(self, seconds: float) -> None:
        """Step the world for `seconds`."""
        self._world.step_until(self._world.time + max(seconds, 0.0))


class SimReferee:
    """The simulator's truth as counts, for the score."""

    def __init__(self, world: SimWorld) -> None:
        self._world = world

    def on_table(self) -> int:
        """Objects inside the workspace cube."""
        return len(self._world.truth().on_table)

    def in_bin(self) -> int:
        """Objects inside the bin."""
        return len(self._world.truth().in_bin)


class SimRounds:
    """Sets the simulated table: round `k` of seed `s` is always the same scene."""

    def __init__(self, world: SimWorld) -> None:
        self._world = world

    def prepare(self, round_index: int, seed: int) -> int:
        """Build the round's scene; how many objects it has.

        Raises:
            BadInput: no object fits the scene's kind.
            SceneError: nothing at rest came out of several attempts.
        """
        words = np.random.SeedSequence([seed, round_index]).generate_state(1, np.uint32)
        return self._world.new_round(int(words[0]))


__all__ = ["SimClock", "SimReferee", "SimRounds", "SimWorld", "Truth"]
