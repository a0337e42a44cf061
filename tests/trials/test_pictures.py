"""Pictures show the grasp where it is; films stay small."""

import io

import numpy as np
import pytest
from PIL import Image

from evg_app.events import FrameTaken, GraspsPlanned, Judged
from evg_app.geometry import look_at, make, translation
from evg_app.trials.arrays import Gathered
from evg_app.trials.film import Film
from evg_app.trials.pictures import GRIPPER, depth_as_color, draw, gripper_lines, png, project
from evg_app.types import Frame, Grasps, Intrinsics, Verdict

PIXEL_ATOL = 1e-6
"""Projection [px]."""
CAMERA = Intrinsics(160, 120, 140.0, 140.0, 80.0, 60.0)
DOWN = make(np.diag([1.0, -1.0, -1.0]), [0.15, 0.15, 0.12])
"""A grasp from above in the middle of the workspace (task frame)."""


def _gathered(with_color: bool) -> Gathered:
    rng = np.random.default_rng(0)
    depth = rng.integers(400, 800, (120, 160)).astype(np.uint16)
    color = np.full((120, 160, 3), 40, np.uint8) if with_color else None
    frame = Frame(depth, 0.001, CAMERA, 1.0, "cam", color)
    T_base_task = translation(0.3, -0.15, 0.0)
    T_base_cam = T_base_task @ look_at([0.15, -0.3, 0.5], [0.15, 0.15, 0.1])
    grasps = Grasps(np.stack([DOWN, DOWN @ translation(0.05, 0, 0)]), np.full(2, 0.05), np.array([0.9, 0.4]))
    gathered = Gathered()
    gathered.take(FrameTaken(frame, np.zeros(7), T_base_cam, T_base_task))
    gathered.take(GraspsPlanned(grasps))
    gathered.take(Judged((Verdict.ACCEPTED, Verdict.IK), 0, False, T_base_task @ DOWN, {}))
    return gathered


@pytest.mark.parametrize("with_color", [True, False])
def test_the_gripper_is_drawn_where_the_grasp_projects(with_color):
    image = draw(_gathered(with_color), "seed 0: success")
    assert image.shape == (120, 160, 3)
    v, u = np.nonzero((image == GRIPPER).all(axis=2))
    assert len(u) > 30
    centre = project(np.array([[0.0, 0.0, np.linalg.norm([0.45, 0.4])]]), CAMERA)[0]
    assert abs(np.array([u.mean(), v.mean()]) - centre).max() < 25


def test_a_pass_without_a_frame_has_no_picture():
    assert draw(Gathered(), "nothing") is None


def test_projection_is_the_pinhole_model_and_nothing_behind_the_camera():
    pixels = project(np.array([[0.1, -0.2, 2.0], [0.0, 0.0, -1.0]]), CAMERA)
    assert pixels[0] == pytest.approx([0.05 * 140 + 80, -0.1 * 140 + 60], abs=PIXEL_ATOL)
    assert np.isnan(pixels[1]).all()


def test_the_wireframe_ends_at_the_finger_tips():
    lines = gripper_lines(0.06)
    assert lines[..., 2].max() == 0.05 and np.ptp(lines[2:, :, 1]) == pytest.approx(0.06)


def test_near_is_brighter_than_far_and_no_measurement_is_black():
    depth = np.linspace(300, 900, 48).reshape(6, 8).astype(np.uint16)
    depth[0, 3] = 0
    color = depth_as_color(Frame(depth, 0.001, CAMERA, 0.0, "cam")).astype(int)
    assert color[0, 0].sum() > color[-1, -1].sum() and color[0, 3].sum() == 0
    assert depth_as_color(Frame(np.zeros((2, 2), np.uint16), 0.001, CAMERA, 0.0, "cam")).sum() == 0


def test_a_png_reads_back_exactly():
    image = draw(_gathered(True), "x")
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(png(image)))), image)


def test_a_film_of_any_length_is_bounded_and_spans_the_run(tmp_path):
    film = Film(width=64, max_frames=20)
    for i in range(1000):
        image = np.zeros((48, 64, 3), np.uint8)
        image[: 1 + i * 48 // 1000] = 255
        film.add(image)
    assert 10 <= len(film) < 20
    film.save(tmp_path / "run.gif")
    with Image.open(tmp_path / "run.gif") as gif:
        gif.seek(gif.n_frames - 1)
        last = np.asarray(gif.convert("RGB")).mean()
        assert gif.n_frames >= 8
    assert last > 200


def test_a_film_that_would_be_too_big_drops_frames_until_it_fits(tmp_path):
    rng, film = np.random.default_rng(1), Film(width=96, max_frames=64, max_bytes=60_000)
    for _ in range(60):
        film.add(rng.integers(0, 255, (96, 96, 3)).astype(np.uint8))
    assert 0 < film.save(tmp_path / "run.gif") <= 60_000


def test_an_empty_film_is_no_file(tmp_path):
    assert Film().save(tmp_path / "run.gif") == 0 and not (tmp_path / "run.gif").exists()
