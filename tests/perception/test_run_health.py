"""Depth is judged against the known table before a run: each number is right, and each fault is named."""

import numpy as np
import pytest

from evg_app.config.files import load_camera
from evg_app.errors import Refused
from evg_app.geometry import TABLE_HEIGHT, invert, look_at, rotation_about, translation
from evg_app.perception.run_health import run_health
from evg_app.perception.table_health import table_health
from evg_app.types import Frame, Intrinsics

NOISE_M = 0.0003
"""How far the measured noise may be from the true one."""
BIAS_M = 0.001
TILT_DEG = 0.15
CAMERA = Intrinsics(848, 480, 426.678, 426.67822, 427.25256, 234.44296)
T_TASK_CAM = look_at([0.15, -0.25, 0.5], [0.15, 0.15, 0.05])
T_CAM_TASK = invert(T_TASK_CAM)
CONFIG = load_camera("d435i")


def table(noise=0.0, scale=1.0, raised=0.0, tilt_deg=0.0, valid=1.0, box=False, seed=0):
    """Depth of the table; `raised` [m] and `tilt_deg` move it about the workspace's middle, `box` puts one on it."""
    rng = np.random.default_rng(seed)
    middle = translation(0.15, 0.15, TABLE_HEIGHT + raised)
    normal = (middle @ rotation_about("x", np.radians(tilt_deg)))[:3, 2]
    u, v = np.meshgrid(np.arange(848), np.arange(480))
    rays = (
        np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], -1)
        @ T_TASK_CAM[:3, :3].T
    )
    depth = ((middle[:3, 3] - T_TASK_CAM[:3, 3]) @ normal) / (rays @ normal)
    if box:
        depth[200:300, 350:500] -= 0.05
    depth = (depth + rng.normal(0, noise, depth.shape)) * scale if noise else depth * scale
    kept = (rng.random(depth.shape) < valid) & (depth > 0) & (depth < 2)
    raw = np.where(kept, np.rint(depth / 1e-4), 0).astype(np.uint16)
    return Frame(raw, 1e-4, CAMERA, 0.0, "cam")


def test_exact_table_is_healthy_and_measured_as_exact():
    health = run_health(table(), T_CAM_TASK, CONFIG)
    health.require()
    assert health.table.noise < NOISE_M
    assert abs(health.table.bias) < BIAS_M
    assert health.table.tilt_deg < TILT_DEG


@pytest.mark.parametrize("noise", [0.001, 0.003])
def test_noise_is_its_standard_deviation_though_objects_stand_on_the_table(noise):
    measured = table_health(table(noise=noise, box=True), T_CAM_TASK)
    assert measured.noise == pytest.approx(noise, rel=0.1, abs=NOISE_M)
    assert abs(measured.bias) < BIAS_M


@pytest.mark.parametrize("tilt_deg", [1.0, 3.0])
def test_tilt_is_the_angle_between_the_planes_and_no_noise(tilt_deg):
    measured = table_health(table(tilt_deg=tilt_deg), T_CAM_TASK)
    assert measured.tilt_deg == pytest.approx(tilt_deg, abs=TILT_DEG)
    assert measured.noise < NOISE_M


@pytest.mark.parametrize("scale", [0.97, 1.02])
def test_bias_is_the_distance_error_at_the_middle_of_the_workspace(scale):
    measured = table_health(table(noise=0.001, scale=scale), T_CAM_TASK)
    distance = float((T_CAM_TASK @ [0.15, 0.15, TABLE_HEIGHT, 1.0])[2])
    assert measured.bias_ratio == pytest.approx(scale - 1, abs=0.002)
    assert measured.bias == pytest.approx((scale - 1) * distance, abs=0.0015)


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (table(valid=0.05), "without depth"),
        (table(noise=0.009), "noisy"),
        (table(tilt_deg=4.0), "tilted"),
        (table(scale=0.94), "mm off"),
        (table(raised=0.4), "not recognised|No surface"),
    ],
)
def test_each_fault_refuses_the_run_with_its_own_advice_and_a_command(frame, words):
    health = run_health(frame, T_CAM_TASK, CONFIG)
    with pytest.raises(Refused, match=words) as caught:
        health.require()
    assert "Run: evg-app" in str(caught.value) and caught.value.exit_code == 3


def test_inverted_calibration_is_refused():
    with pytest.raises(Refused):
        run_health(table(), T_TASK_CAM, CONFIG).require()


def test_limits_are_the_configs():
    frame = table(noise=0.004)
    assert run_health(frame, T_CAM_TASK, CONFIG).ok
    assert not run_health(frame, T_CAM_TASK, CONFIG.model_copy(update={"max_table_noise_m": 0.002})).ok


def test_measures_are_finite_numbers_for_the_log():
    for frame in (table(), table(valid=0.0)):
        measures = run_health(frame, T_CAM_TASK, CONFIG).measures()
        assert np.isfinite(list(measures.values())).all()
        assert len(measures) == 8
