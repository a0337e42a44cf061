"""Scenes settle inside the cube and are functions of their seed."""

import numpy as np
import pytest

from evg_app.errors import BadInput
from evg_app.geometry import TABLE_HEIGHT, WORKSPACE_SIZE, invert, transform_points, translation
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.bullet import connect
from evg_app.simulation.scenes import (
    KINDS,
    REST_STEPS,
    Poisson,
    SceneRecipe,
    add_table,
    build_scene,
    generate_scene_state,
    step,
)

MOVE_TOLERANCE_M = 0.001
BELOW_TABLE_M = 0.002
POSE_TOLERANCE = 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_scene_settles_inside_the_cube_above_the_table(kind):
    for seed in range(3):
        state = generate_scene_state(SceneRecipe(kind, 4), builtin_objects("train"), seed)
        assert 1 <= len(state.objects) <= 4
        for thing in state.objects:
            origin = thing.T_task_object[:3, 3]
            assert (origin >= 0).all() and (origin <= WORKSPACE_SIZE).all()
            assert thing.visual().vertices[:, 2].min() > TABLE_HEIGHT - BELOW_TABLE_M


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_moves_any_more(kind):
    client = connect()
    try:
        add_table(client, np.eye(4))
        rng = np.random.default_rng(5)
        placed = build_scene(client, SceneRecipe(kind, 4), builtin_objects("test"), rng, visible=False)
        before = [p.T_task_object(client, np.eye(4)) for p in placed]
        step(client, REST_STEPS)
        for T_before, thing in zip(before, placed, strict=True):
            moved = thing.T_task_object(client, np.eye(4))[:3, 3] - T_before[:3, 3]
            assert np.linalg.norm(moved) < MOVE_TOLERANCE_M
    finally:
        client.disconnect()


@pytest.mark.parametrize("kind", ["packed", "pile"])
def test_same_seed_gives_identical_poses(kind):
    recipe = SceneRecipe(kind, Poisson(4.0))
    first, second, other = (generate_scene_state(recipe, builtin_objects("train"), s) for s in (11, 11, 12))
    assert [o.name for o in first.objects] == [o.name for o in second.objects]
    for a, b in zip(first.objects, second.objects, strict=True):
        assert a.scale == b.scale
        np.testing.assert_array_equal(a.T_task_object, b.T_task_object)
    assert [o.name for o in first.objects] != [o.name for o in other.objects]


def test_packed_objects_stand_upright():
    state = generate_scene_state(SceneRecipe("packed", 5), builtin_objects("train"), 0)
    upright = [o.T_task_object[2, 2] > 0.99 for o in state.objects]
    assert np.mean(upright) > 0.5


def test_scene_can_be_built_in_a_shifted_task_frame():
    T_world_task = translation(0.35, -0.15, -0.05)
    client = connect()
    try:
        add_table(client, T_world_task)
        rng = np.random.default_rng(3)
        placed = build_scene(client, SceneRecipe("packed", 3), builtin_objects("test"), rng, T_world_task, False)
        for thing in placed:
            low, _ = client.getAABB(thing.body)
            assert abs(low[2]) < 0.01
            assert (thing.T_task_object(client, T_world_task)[:3, 3] > 0).all()
    finally:
        client.disconnect()


def test_unknown_kind_is_refused():
    with pytest.raises(BadInput, match="adversarial"):
        SceneRecipe("messy")


def test_occupancy_agrees_with_the_surface():
    state = generate_scene_state(SceneRecipe("pile", 3), builtin_objects("train"), 1)
    for thing in state.objects:
        for part in thing.parts():
            assert state.occupied(part.vertices.mean(axis=0)[None]).all()
        radius = np.linalg.norm(thing.visual().vertices - thing.T_task_object[:3, 3], axis=1).max()
        far = thing.T_task_object[:3, 3] + (radius + 0.001) * np.eye(3)
        assert not thing.contains(far).any()
        local = transform_points(invert(thing.T_task_object), thing.visual().vertices)
        assert np.ptp(local, axis=0).max() < 0.2
