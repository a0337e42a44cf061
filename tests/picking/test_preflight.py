"""The camera is judged before a run: shown, logged, and refused with advice when it is too bad."""

import json
import sqlite3
from dataclasses import replace

import numpy as np
import pytest
from picking_fakes import Lab

from evg_app.config.files import load_camera
from evg_app.errors import Refused
from evg_app.events import DepthChecked
from evg_app.geometry import TABLE_HEIGHT, look_at
from evg_app.picking.context import Devices
from evg_app.picking.perceive import TablePerception
from evg_app.picking.preflight import TRIES, check_depth
from evg_app.trials.store import TrialStore
from evg_app.types import Frame

CONFIG = load_camera("d435i")
T_TASK_CAM = look_at([0.15, -0.25, 0.5], [0.15, 0.15, 0.05])
NOISE_M = 0.002


def table_depth() -> np.ndarray:
    """Depth of the table with noise, in millimetres."""
    K = CONFIG.simulated_intrinsics()
    u, v = np.meshgrid(np.arange(K.width), np.arange(K.height))
    rays = np.stack([(u - K.cx) / K.fx, (v - K.cy) / K.fy, np.ones(u.shape)], -1) @ T_TASK_CAM[:3, :3].T
    depth = (TABLE_HEIGHT - T_TASK_CAM[2, 3]) / rays[..., 2]
    depth += np.random.default_rng(0).normal(0, NOISE_M, depth.shape)
    return np.where((depth > 0) & (depth < 2), np.rint(depth * 1e3), 0).astype(np.uint16)


class Camera:
    """Gives these images one after the other, the last one for ever."""

    def __init__(self, *images):
        self.images, self.taken = list(images), 0

    def capture(self, *, after, timeout):
        image = self.images[min(self.taken, len(self.images) - 1)]
        self.taken += 1
        return Frame(image, 0.001, CONFIG.simulated_intrinsics(), after, "cam")


def context(camera, sink):
    ctx = Lab().context()
    devices = Devices(camera, ctx.devices.arm, ctx.devices.gripper, ctx.devices.clock)
    perception = TablePerception(np.eye(4), lambda q: T_TASK_CAM, lambda q: [])
    return replace(ctx, devices=devices, perception=perception, camera=CONFIG, sink=sink)


def test_good_camera_passes_and_its_numbers_are_in_the_log(tmp_path):
    store = TrialStore(tmp_path, {})
    health = check_depth(context(Camera(table_depth()), store))
    store.close()
    assert health.ok and health.table.noise == pytest.approx(NOISE_M, rel=0.1)
    kind, data = sqlite3.connect(tmp_path / "trials.sqlite").execute("SELECT kind, data FROM events").fetchone()
    assert kind == "DepthChecked"
    assert json.loads(data)["measures"]["table_noise_m"] == pytest.approx(health.table.noise)


def test_dark_camera_is_refused_after_a_bounded_number_of_frames_each_of_them_logged():
    heard, camera = [], Camera(0 * table_depth())
    with pytest.raises(Refused, match="without depth"):
        check_depth(context(camera, heard.append))
    assert len(heard) == camera.taken == TRIES
    assert all(isinstance(event, DepthChecked) and event.advice for event in heard)


def test_hand_before_the_camera_does_not_refuse_a_run():
    heard = []
    check_depth(context(Camera(0 * table_depth(), table_depth()), heard.append))
    assert [bool(event.advice) for event in heard] == [True, False]


def test_with_the_arm_in_the_way_bad_depth_is_said_and_not_refused():
    heard = []
    assert check_depth(context(Camera(0 * table_depth()), heard.append), refuse=False).advice
    assert len(heard) == TRIES
