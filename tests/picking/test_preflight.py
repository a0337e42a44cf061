"""The camera is judged before a run: shown, logged, and refused with advice when it is too bad."""

import json
import sqlite3

import numpy as np
import pytest

from evg_app.clock import WallClock
from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.errors import Refused
from evg_app.events import DepthChecked
from evg_app.geometry import invert, look_at
from evg_app.picking.preflight import TRIES, check_depth
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.camera import SimulatedCamera
from evg_app.simulation.world import SimClock, SimWorld
from evg_app.trials.store import TrialStore
from evg_app.types import Frame

CONFIG = load_camera("d435i")
LOOKING_DOWN = invert(look_at([0.15, 0.15, 0.65], [0.15, 0.15, 0.0], up=[0, 1, 0]))


class Dark:
    """A camera with its lens cap on."""

    def capture(self, *, after, timeout):
        K = CONFIG.simulated_intrinsics()
        return Frame(np.zeros((K.height, K.width), np.uint16), 0.001, K, after, "cam")


@pytest.fixture
def world():
    world = SimWorld(
        load_robot("panda"), load_world("packed").model_copy(update={"noise": "gaussian"}), builtin_objects("test")
    )
    yield world
    world.close()


def test_good_camera_passes_and_its_numbers_are_in_the_log(world, tmp_path):
    camera = SimulatedCamera(world, CONFIG)
    store = TrialStore(tmp_path, {})
    health = check_depth(camera, SimClock(world), invert(camera.T_base_cam) @ world.T_base_task, CONFIG, store)
    store.close()
    assert health.ok and health.table.seen and health.table.noise < 0.002
    kind, payload = sqlite3.connect(tmp_path / "trials.sqlite").execute("SELECT kind, data FROM events").fetchone()
    assert kind == "DepthChecked"
    assert json.loads(payload)["measures"]["table_noise_m"] == pytest.approx(health.table.noise)


def test_bad_camera_is_refused_after_a_bounded_number_of_frames_each_of_them_logged():
    heard = []
    with pytest.raises(Refused, match="without depth"):
        check_depth(Dark(), WallClock(), LOOKING_DOWN, CONFIG, heard.append)
    assert len(heard) == TRIES
    assert all(isinstance(event, DepthChecked) and event.advice for event in heard)
