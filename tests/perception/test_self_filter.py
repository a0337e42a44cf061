"""The arm's own links leave the depth image, the scene stays."""

import time

import numpy as np
import pytest

from evg_app.geometry import invert, look_at, transform_points
from evg_app.perception.self_filter import Capsule, remove_links
from evg_app.types import Intrinsics

SURFACE_TOLERANCE = 1e-4
"""Distance to the link's surface [m] within which float32 may decide either way."""
TIME_BOUND = 0.06
"""[s], median, for 40 links; measured under 10 ms."""

CAMERA = Intrinsics(848, 480, 426.678, 426.67822, 427.25256, 234.44296)
T_CAM_BASE = invert(look_at([0.5, -0.7, 0.6], [0.5, 0.0, 0.1]))


def rays():
    """Unit-depth rays of all pixels in the camera frame. Shape (H, W, 3)."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    return np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)


def render(spheres, background=1.2):
    """Depth [m] of spheres (centre, radius in the base frame) before a flat background."""
    d = rays()
    depth = np.full(d.shape[:2], background)
    for centre, radius in spheres:
        c = transform_points(T_CAM_BASE, centre)
        a, b = (d * d).sum(-1), d @ c
        root = b * b - a * (c @ c - radius**2)
        hit = root > 0
        depth[hit] = np.minimum(depth[hit], ((b - np.sqrt(np.maximum(root, 0))) / a)[hit])
    return depth.astype(np.float32)


def arm(n=40):
    """A chain of capsules across the view."""
    x = np.linspace(0.2, 0.8, n + 1)
    points = np.stack([x, 0.1 * np.sin(8 * x), 0.2 + 0.2 * x], axis=1)
    return [Capsule(points[i], points[i + 1], 0.06) for i in range(n)]


def test_every_pixel_of_the_link_goes_and_no_pixel_of_the_scene():
    link, item = (np.array([0.5, 0.0, 0.3]), 0.08), (np.array([0.7, 0.0, 0.1]), 0.05)
    with_link, without = render([link, item]), render([item])
    filtered, removed = remove_links(with_link, CAMERA, T_CAM_BASE, [Capsule(link[0], link[0], link[1])])
    seen_link = with_link < without - 1e-6
    assert seen_link.sum() > 1000
    assert (filtered[seen_link] == 0).all() and removed[seen_link].all()
    assert np.array_equal(filtered[~seen_link], with_link[~seen_link])


def test_a_capsule_is_its_segment_thickened():
    a, b, r = np.array([0.3, 0.0, 0.3]), np.array([0.6, 0.1, 0.2]), 0.05
    T_base_cam = invert(T_CAM_BASE)
    depth = np.random.default_rng(0).uniform(0.3, 1.5, (480, 848)).astype(np.float32)
    _, removed = remove_links(depth, CAMERA, T_CAM_BASE, [Capsule(a, b, r)], padding=0.0)
    points = transform_points(T_base_cam, rays() * depth[..., None])
    t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    distance = np.linalg.norm(points - (a + t[..., None] * (b - a)), axis=-1)
    assert removed.sum() > 500
    clear = np.abs(distance - r) > SURFACE_TOLERANCE
    assert np.array_equal(removed[clear], (distance < r)[clear])


def test_padding_catches_a_badly_calibrated_link():
    link = np.array([0.5, 0.0, 0.3])
    depth = render([(link, 0.08)])
    wrong = np.array([0.515, 0.0, 0.315])
    shifted = Capsule(wrong, wrong, 0.08)
    bare, _ = remove_links(depth, CAMERA, T_CAM_BASE, [shifted], padding=0.0)
    padded, _ = remove_links(depth, CAMERA, T_CAM_BASE, [shifted])
    arm_pixels = depth < 1.19
    assert (bare[arm_pixels] > 0).any() and not (padded[arm_pixels] > 0).any()


def test_uint16_and_metres_agree_and_the_input_is_untouched():
    depth = (render([(np.array([0.5, 0.0, 0.3]), 0.08)]) * 1000).round().astype(np.uint16)
    before = depth.copy()
    a, _ = remove_links(depth, CAMERA, T_CAM_BASE, arm(), depth_scale=0.001)
    b, _ = remove_links(depth.astype(np.float32) * np.float32(0.001), CAMERA, T_CAM_BASE, arm())
    assert a.dtype == np.uint16 and np.array_equal(depth, before)
    assert ((a == 0) != (b == 0)).mean() < 1e-4


@pytest.mark.parametrize("where", [[0.5, -0.75, 0.65], [0.5, -2.0, 1.0]])
def test_links_at_or_behind_the_camera_do_no_harm(where):
    depth = render([])
    filtered, _ = remove_links(depth, CAMERA, T_CAM_BASE, [Capsule(np.array(where), np.array(where), 0.05)])
    assert np.array_equal(filtered, depth)


def test_forty_links_take_milliseconds():
    depth = render([(link.p0, link.radius) for link in arm()])
    times = []
    for _ in range(7):
        start = time.perf_counter()
        remove_links(depth, CAMERA, T_CAM_BASE, arm())
        times.append(time.perf_counter() - start)
    assert np.median(times) < TIME_BOUND
