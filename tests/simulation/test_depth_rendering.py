"""Ray-cast depth against geometry, TinyRenderer against ray casting, and the camera presets."""

import numpy as np
import pytest

from evg_app.errors import UnknownName
from evg_app.geometry import TABLE_HEIGHT, from_quaternion, invert, look_at, transform_points
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.bullet import connect, load_object, static_box
from evg_app.simulation.camera import render
from evg_app.simulation.rendering import SceneCaster, camera_rays, project
from evg_app.simulation.scenes import PlacedObject, SceneRecipe, add_table, build_scene, generate_scene_state, snapshot
from evg_app.simulation.state import SceneState
from evg_app.simulation.views import D435I, FAR, NEAR, RANDOM_VIEWS, draw_view, side_view
from evg_app.types import Intrinsics

DEPTH_TOLERANCE_M = 1e-5
RENDERER_MEDIAN_M = 0.001
SMALL = Intrinsics(106, 60, 53.33, 53.33, 53.4, 29.3)


def test_side_view_is_the_published_one():
    expected = from_quaternion([-0.8660254, 0, 0, -0.5], [-0.15, 0.1616, 0.5201])
    np.testing.assert_allclose(invert(side_view()), expected, atol=1e-4)
    np.testing.assert_allclose(side_view()[:3, 3], [0.15, -0.3696, 0.4], atol=1e-4)


@pytest.mark.parametrize("name", list(RANDOM_VIEWS))
def test_random_views_look_at_the_workspace_from_their_range(name):
    for seed in range(30):
        T_task_cam = draw_view(name, np.random.default_rng(seed))
        pixel, depth = project(D435I, T_task_cam, np.array([[0.15, 0.15, 0.1]]))
        assert 0.3 < depth[0] < 1.0
        assert abs(pixel[0, 0] - D435I.cx) < 2 and 0 < pixel[0, 1] < D435I.height


def test_unknown_view_is_refused():
    with pytest.raises(UnknownName, match="side"):
        draw_view("from below", np.random.default_rng(0))


def test_empty_table_is_an_exact_plane():
    depth = SceneCaster(SceneState(())).depth(SMALL, side_view())
    v, u = np.nonzero(depth)
    assert len(u) > 1000
    origins, directions = camera_rays(SMALL, side_view(), np.stack([u, v], axis=1))
    points = origins + depth[v, u, None] * directions
    np.testing.assert_allclose(points[:, 2], TABLE_HEIGHT, atol=DEPTH_TOLERANCE_M)


def test_depth_at_pixels_equals_the_image_and_range_is_kept():
    state = generate_scene_state(SceneRecipe("pile", 3), builtin_objects("train"), 2)
    caster = SceneCaster(state)
    image = caster.depth(SMALL, side_view())
    v, u = np.mgrid[: SMALL.height, : SMALL.width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)[::3]
    np.testing.assert_array_equal(caster.depth_at(SMALL, side_view(), pixels), image[pixels[:, 1], pixels[:, 0]])
    seen = image[image > 0]
    assert seen.min() >= NEAR and seen.max() <= FAR


def test_depth_of_a_cube_seen_from_above_is_its_top():
    model = next(m for m in builtin_objects("train") if m.family == "cube")
    client = connect()
    T_task_object = np.eye(4)
    T_task_object[:3, 3] = [0.15, 0.15, TABLE_HEIGHT + model.extents[2] / 2]
    placed = PlacedObject(model, load_object(client, model, 1.0, T_task_object, False), 1.0)
    state = snapshot(client, [placed])
    client.disconnect()
    above = look_at([0.15, 0.15, 0.6], [0.15, 0.15, 0.0], up=(0.0, 1.0, 0.0))
    depth = SceneCaster(state).depth_at(SMALL, above, np.array([[53, 29], [5, 5]]))
    np.testing.assert_allclose(depth, [0.55 - model.extents[2], 0.55], atol=DEPTH_TOLERANCE_M)


def test_projection_inverts_rays():
    rng = np.random.default_rng(4)
    pixels = rng.integers(0, 60, (50, 2))
    origins, directions = camera_rays(SMALL, side_view(), pixels)
    z = rng.uniform(0.3, 1.0, 50)
    again, depth = project(SMALL, side_view(), origins + z[:, None] * directions)
    np.testing.assert_array_equal(again, pixels)
    np.testing.assert_allclose(depth, z, atol=1e-9)


def test_tiny_renderer_agrees_with_ray_casting_to_the_row():
    client = connect()
    try:
        add_table(client, np.eye(4))
        rng = np.random.default_rng(1)
        placed = build_scene(client, SceneRecipe("pile", 5), builtin_objects("test"), rng)
        _, drawn = render(client, D435I, side_view(), NEAR, FAR)
        cast = SceneCaster(snapshot(client, placed)).depth(D435I, side_view())
    finally:
        client.disconnect()
    both = (drawn > 0) & (cast > 0)
    assert both.sum() > 100_000
    above_table = _heights(cast) > TABLE_HEIGHT + 0.003
    error = np.abs(drawn - cast)
    assert np.median(error[both]) < 1e-5
    assert np.median(error[both & above_table]) < RENDERER_MEDIAN_M


def test_tiny_renderer_draws_a_box_where_it_is():
    client = connect()
    try:
        static_box(client, np.array([0.1, 0.1, 0.1]), np.array([0.15, 0.15, 0.10]), (1.0, 0.0, 0.0, 1.0), 0.5)
        color, depth = render(client, D435I, side_view(), NEAR, FAR)
    finally:
        client.disconnect()
    v, u = np.nonzero(depth)
    origins, directions = camera_rays(D435I, side_view(), np.stack([u, v], axis=1))
    points = origins + depth[v, u, None] * directions
    assert color[v, u, 0].mean() > 2 * color[v, u, 1].mean()
    np.testing.assert_allclose(points.min(axis=0), [0.10, 0.10, 0.05], atol=0.003)
    np.testing.assert_allclose(points.max(axis=0)[[0, 2]], [0.20, 0.15], atol=0.003)


def _heights(depth: np.ndarray) -> np.ndarray:
    v, u = np.mgrid[: D435I.height, : D435I.width]
    origins, directions = camera_rays(D435I, side_view(), np.stack([u.ravel(), v.ravel()], axis=1))
    points = transform_points(np.eye(4), origins + depth.reshape(-1, 1) * directions)
    return points[:, 2].reshape(depth.shape)
