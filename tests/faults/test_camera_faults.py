"""The real camera driver fails in the middle of a run: noticed in bounded time, the arm stays, the log is complete."""

import sqlite3
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from picking_fakes import LOOK, Lab

sys.path.insert(0, str(Path(__file__).parent.parent / "cameras"))

from recordings import HEIGHT, WIDTH, write_recording
from stand_in import Bus

from evg_app.cameras.realsense import connection, devices, link
from evg_app.cameras.realsense.camera import RealSenseCamera
from evg_app.clock import WallClock
from evg_app.config.files import load_camera
from evg_app.events import MotionStarted, RoundFinished, Warned, fan_out
from evg_app.picking.context import Devices
from evg_app.picking.run import run_rounds
from evg_app.trials.folder import make
from evg_app.trials.store import TrialStore

pytestmark = pytest.mark.slow

STALL_S = 0.4
FIRST_FRAME_S = 0.3
SLACK_S = 1.5
"""What a busy machine may add to a time to detection, the loop's own work included."""
FLAT = np.full((HEIGHT, WIDTH), 600, np.uint16)
SECONDS = 0.6
"""Longer than the stream that breaks off."""


@pytest.fixture(scope="module")
def streams(tmp_path_factory):
    """Recordings by name: one for ever, one that breaks off, one without depth values, one without depth frames."""
    folder = tmp_path_factory.mktemp("faults")
    return {
        "good": write_recording(folder / "good.db3", [FLAT] * 10),
        "once": write_recording(folder / "once.db3", [FLAT] * 10),
        "dark": write_recording(folder / "dark.db3", [0 * FLAT] * 10),
        "silent": write_recording(folder / "silent.db3", [None] * 60 + [FLAT]),
    }


class Broken:
    """A round of the fakes' lab with the real camera driver on this bus."""

    def __init__(self, bus, folder, monkeypatch):
        monkeypatch.setattr(connection, "FIRST_FRAME", FIRST_FRAME_S)
        monkeypatch.setattr(link, "STOP_TIMEOUT", 0.3)
        monkeypatch.setattr(devices, "USB_DEVICES", folder)
        self.lab = Lab("S" * 12, objects=12, recheck=False)
        self.folder = make(folder / "run")
        self.store = TrialStore(self.folder, {})
        config = load_camera("d435i")
        quick = {"stall_s": STALL_S, "warmup_s": 0.0, "average_frames": 1, "reset_timeout_s": 0.5}
        config = config.model_copy(update={"realsense": config.realsense.model_copy(update=quick)})
        ctx = self.lab.context()
        sink = fan_out(ctx.sink, self.store)
        with RealSenseCamera(config, WallClock(), lambda c, text: sink(Warned(c, text)), sdk=bus) as camera:
            given = Devices(camera, ctx.devices.arm, ctx.devices.gripper, ctx.devices.clock)
            self.result = run_rounds(replace(ctx, devices=given, sink=sink), self.lab, (0,), 1)
        self.store.close()

    @property
    def detail(self):
        return self.lab.of(RoundFinished)[0].detail

    def attempts(self):
        """Outcome of every attempt in the log, and what was said during it."""
        log = sqlite3.connect(self.folder / "trials.sqlite")
        rows = log.execute("SELECT attempt_id, outcome FROM attempts ORDER BY attempt_index").fetchall()
        said = "SELECT data FROM events WHERE attempt_id = ? AND kind = 'Warned'"
        return [(outcome, "".join(data for (data,) in log.execute(said, [name]))) for name, outcome in rows]


def run_and_break(bus, folder, monkeypatch, after):
    """Run; when the first object is dropped, do `after` once the stream that breaks off has done so."""

    def watch(self, event):
        original(self, event)
        if isinstance(event, MotionStarted) and event.name == "drop" and not self.broken:
            self.broken = True
            time.sleep(SECONDS)
            after()
            broken.append(time.monotonic())

    original, broken = Lab.sink, []
    monkeypatch.setattr(Lab, "broken", False, raising=False)
    monkeypatch.setattr(Lab, "sink", watch)
    run = Broken(bus, folder, monkeypatch)
    run.seconds = time.monotonic() - broken[0]
    return run


def assert_stopped_and_logged(run):
    lab = run.lab
    assert lab.reasons == ["error"] and run.result.exit_code == 4
    assert np.allclose(lab.arm.q, LOOK, atol=0.02), "the arm stays where it was when the camera failed"
    assert [event.name for event in lab.of(MotionStarted)][-1] in ("return", "look")
    logged = run.attempts()
    assert [outcome for outcome, _ in logged[:-1]] == ["success"] * (len(logged) - 1)
    assert logged[-1][0] == "error" and "device error" in logged[-1][1]
    assert "evg-app" in run.detail


def test_camera_unplugged_during_a_pick_ends_the_round_with_the_next_command(streams, tmp_path, monkeypatch):
    bus = Bus([streams["once"]]).plug("77")
    run = run_and_break(bus, tmp_path, monkeypatch, bus.cameras.clear)
    assert_stopped_and_logged(run)
    assert "camera 77 has left USB" in run.detail
    assert run.seconds < STALL_S + 0.3 + SLACK_S


def test_stream_that_breaks_off_is_started_again_and_the_run_goes_on(streams, tmp_path, monkeypatch):
    bus = Bus([streams["once"], streams["good"]]).plug("77")
    run = run_and_break(bus, tmp_path, monkeypatch, lambda: None)
    assert run.lab.reasons == ["cleared"] and run.result.exit_code == 0
    assert run.lab.warnings == ["camera stall"]


def test_stream_that_never_comes_back_is_given_up_after_a_reset(streams, tmp_path, monkeypatch):
    bus = Bus([streams["once"], streams["silent"]]).plug("77")
    run = run_and_break(bus, tmp_path, monkeypatch, lambda: None)
    assert_stopped_and_logged(run)
    assert bus.resets == ["77"]
    assert run.lab.warnings == [
        "camera stall",
        "camera start",
        "camera start",
        "camera reset",
        "camera start",
        "device error",
    ]
    assert run.seconds < STALL_S + 4 * 0.3 + 3 * FIRST_FRAME_S + SLACK_S


def test_depth_that_turns_dark_is_refused_and_not_planned_on(streams, tmp_path, monkeypatch):
    bus = Bus([streams["once"], streams["dark"]]).plug("77")
    run = run_and_break(bus, tmp_path, monkeypatch, lambda: None)
    assert_stopped_and_logged(run)
    assert "holds no depth" in run.detail
    assert run.lab.warnings == ["camera stall", "frame refused", "frame refused", "frame refused", "device error"]
