"""Scenes by recipe (spec §4.2), built in PyBullet and settled.

Physics runs in a world frame; `T_world_task` says where the task frame's corner is (a translation, z up).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evg_app.errors import EvgError
from evg_app.geometry import TABLE_HEIGHT, WORKSPACE_SIZE, Array, invert, rotation_about
from evg_app.simulation.bullet import Client, body_pose, connect, load_object, pose, random_rotation, static_box
from evg_app.simulation.objects import ObjectModel, of_kind
from evg_app.simulation.recipes import KINDS, Poisson, SceneRecipe
from evg_app.simulation.state import SceneObject, SceneState

REST_STEPS = 60
"""Steps between two looks at whether anything moves."""
REST_DISTANCE = 0.0005
"""A point of an object that moved further than this between two looks is not at rest [m]."""
TABLE_FRICTION = 0.6
"""Lateral friction of the table top."""

_DROP_HEIGHT = 0.25
_DROP_SPEED = 1.2
_DROP_STEPS = 45
_WALL = (0.02, 0.28, 0.30)
_ATTEMPTS = 12


class SceneError(EvgError):
    """No settled scene came out of a recipe."""


@dataclass(frozen=True)
class PlacedObject:
    """An object that lives in a physics client.

    Attributes:
        model, body, scale: what it is, its PyBullet body id, its scale.
    """

    model: ObjectModel
    body: int
    scale: float

    def T_task_object(self, client: Client, T_world_task: Array) -> Array:
        """Where it is now. Shape (4, 4)."""
        return invert(T_world_task) @ body_pose(client, self.body)


def add_table(client: Client, T_world_task: Array, half_size: float = 0.6) -> int:
    """The table: a static box under task z = 0.05, centred below the workspace; its body id."""
    center = T_world_task[:3, 3] + [WORKSPACE_SIZE / 2, WORKSPACE_SIZE / 2, TABLE_HEIGHT - 0.05]
    size = np.array([2 * half_size, 2 * half_size, 0.1])
    return static_box(client, size, center, (0.83, 0.80, 0.74, 1.0), TABLE_FRICTION)


def step(client: Client, count: int) -> None:
    """Step physics `count` times."""
    for _ in range(count):
        client.stepSimulation()


def settle(client: Client, bodies: Sequence[int], max_rounds: int = 10) -> bool:
    """Step until no body moves more than REST_DISTANCE in REST_STEPS steps; whether that came true."""
    before = _snapshot(client, bodies)
    for _ in range(max_rounds):
        step(client, REST_STEPS)
        after = _snapshot(client, bodies)
        if _largest_move(before, after) < REST_DISTANCE:
            return True
        before = after
    return False


def _snapshot(client: Client, bodies: Sequence[int]) -> Array:
    return np.array([np.concatenate(client.getBasePositionAndOrientation(b)) for b in bodies]).reshape(-1, 7)


def _largest_move(a: Array, b: Array) -> float:
    """Translation plus turn of a point 5 cm away [m]."""
    if not len(a):
        return 0.0
    turn = 2.0 * np.sqrt(np.maximum(0.0, 1.0 - np.einsum("ij,ij->i", a[:, 3:], b[:, 3:]) ** 2))
    return float((np.linalg.norm(a[:, :3] - b[:, :3], axis=1) + 0.05 * turn).max())


def inside_cube(T_task_object: Array) -> bool:
    """Whether an object's origin is inside the workspace cube (spec §4.2)."""
    p = T_task_object[:3, 3]
    return bool((p >= 0.0).all() and (p <= WORKSPACE_SIZE).all())


def remove_outside(client: Client, placed: list[PlacedObject], T_world_task: Array) -> list[PlacedObject]:
    """Take objects away whose origin is outside the cube, and those that lean so far out that they will fall."""
    kept = []
    for thing in placed:
        if inside_cube(thing.T_task_object(client, T_world_task)):
            kept.append(thing)
        else:
            client.removeBody(thing.body)
    return kept


def _walls(client: Client, T_world_task: Array) -> list[int]:
    low, high, height = _WALL
    middle, span, thick = (low + high) / 2, high - low, 0.05
    z = TABLE_HEIGHT + height / 2
    walls = []
    for axis in (0, 1):
        for edge in (low - thick / 2, high + thick / 2):
            center, size = np.array([middle, middle, z]), np.array([span + 2 * thick, span + 2 * thick, height])
            center[axis], size[axis] = edge, thick
            walls.append(static_box(client, size, T_world_task[:3, 3] + center, None, 0.3))
    return walls


def _throw(
    client: Client, recipe: SceneRecipe, objects: Sequence[ObjectModel], rng: np.random.Generator, frame: "_Frame"
) -> PlacedObject:
    model = objects[int(rng.integers(len(objects)))]
    scale = recipe.draw_scale(rng)
    x, y = rng.uniform(0.1, 0.2, 2)
    T_task_object = pose(random_rotation(rng), x, y, _DROP_HEIGHT)
    body = load_object(client, model, scale, frame.T_world_task @ T_task_object, frame.visible)
    client.resetBaseVelocity(body, [0.0, 0.0, -_DROP_SPEED])
    step(client, _DROP_STEPS)
    return PlacedObject(model, body, scale)


@dataclass(frozen=True)
class _Frame:
    T_world_task: Array
    visible: bool


def _pile(
    client: Client, recipe: SceneRecipe, objects: Sequence[ObjectModel], rng: np.random.Generator, frame: _Frame
) -> list[PlacedObject]:
    walls = _walls(client, frame.T_world_task)
    placed = [_throw(client, recipe, objects, rng, frame) for _ in range(recipe.draw_count(rng))]
    settle(client, [p.body for p in placed], 4)
    for wall in walls:
        client.removeBody(wall)
    return placed


def _stand(
    client: Client, model: ObjectModel, scale: float, place: Array, frame: _Frame, others: Sequence[int]
) -> int | None:
    """Put a model upright at `place` (x, y, yaw); its body, or None (and nothing left) if it touches another."""
    T_task_object = pose(rotation_about("z", place[2])[:3, :3], place[0], place[1], 1.0)
    body = load_object(client, model, scale, frame.T_world_task @ T_task_object, frame.visible)
    low, _ = client.getAABB(body)
    origin_z = float(frame.T_world_task[2, 3])
    T_task_object[2, 3] += TABLE_HEIGHT + 0.002 - (low[2] - origin_z)
    client.removeBody(body)
    body = load_object(client, model, scale, frame.T_world_task @ T_task_object, frame.visible)
    if any(client.getClosestPoints(body, other, 0.004) for other in others):
        client.removeBody(body)
        return None
    return body


def _packed(
    client: Client, recipe: SceneRecipe, objects: Sequence[ObjectModel], rng: np.random.Generator, frame: _Frame
) -> list[PlacedObject]:
    placed: list[PlacedObject] = []
    wanted = recipe.draw_count(rng)
    for _ in range(max(_ATTEMPTS, 2 * wanted)):
        if len(placed) == wanted:
            break
        model = objects[int(rng.integers(len(objects)))]
        scale, place = recipe.draw_scale(rng), np.append(rng.uniform(0.08, 0.22, 2), rng.uniform(0.0, 2.0 * np.pi))
        body = _stand(client, model, scale, place, frame, [p.body for p in placed])
        if body is not None:
            placed.append(PlacedObject(model, body, scale))
    return placed


def build_scene(
    client: Client,
    recipe: SceneRecipe,
    objects: Sequence[ObjectModel],
    rng: np.random.Generator,
    T_world_task: Array | None = None,
    visible: bool = True,
) -> list[PlacedObject]:
    """Build one scene on a table that is already there, settle it, and take away what left the cube.

    `visible` loads visual shapes too, for TinyRenderer and the window.

    Raises:
        BadInput: no object fits the recipe's kind.
        SceneError: nothing at rest came out of several attempts.
    """
    fitting = of_kind(tuple(objects), recipe.kind)
    frame = _Frame(np.eye(4) if T_world_task is None else T_world_task, visible)
    make_one = _packed if recipe.kind == "packed" else _pile
    for _ in range(_ATTEMPTS):
        placed = make_one(client, recipe, fitting, rng, frame)
        if placed := _at_rest(client, placed, frame.T_world_task):
            return placed
    raise SceneError(f"no settled '{recipe.kind}' scene in {_ATTEMPTS} attempts; use other objects or fewer of them.")


def _at_rest(client: Client, placed: list[PlacedObject], T_world_task: Array) -> list[PlacedObject]:
    """The objects left in the cube once all are at rest; an empty list (and nothing left) if some keep moving."""
    for _ in range(4):
        resting = settle(client, [p.body for p in placed])
        kept = remove_outside(client, placed, T_world_task)
        if resting and len(kept) == len(placed):
            return kept
        if not resting:
            break
        placed = kept
    for thing in kept:
        client.removeBody(thing.body)
    return []


def snapshot(client: Client, placed: Sequence[PlacedObject], T_world_task: Array | None = None) -> SceneState:
    """The objects of a client, as they lie now, as plain data."""
    T = np.eye(4) if T_world_task is None else T_world_task
    return SceneState(
        tuple(
            SceneObject(
                p.model.name,
                p.model.urdf,
                p.model.collision_mesh,
                p.model.visual_mesh,
                p.scale,
                p.T_task_object(client, T),
                p.model.compound,
            )
            for p in placed
        )
    )


def generate_scene_state(recipe: SceneRecipe, objects: Sequence[ObjectModel], seed: int) -> SceneState:
    """A settled scene as plain data: a pure function of its arguments, in a physics client of its own.

    Raises:
        BadInput: no object fits the recipe's kind.
        SceneError: nothing at rest came out of several attempts.
    """
    client = connect(solver_iterations=30, ordered_pairs=False)
    try:
        add_table(client, np.eye(4))
        placed = build_scene(client, recipe, objects, np.random.default_rng(seed), visible=False)
        return snapshot(client, placed)
    finally:
        client.disconnect()


__all__ = [
    "KINDS",
    "REST_DISTANCE",
    "REST_STEPS",
    "PlacedObject",
    "Poisson",
    "SceneError",
    "SceneRecipe",
    "add_table",
    "build_scene",
    "generate_scene_state",
    "inside_cube",
    "remove_outside",
    "settle",
    "snapshot",
    "step",
]
