"""The view in a real browser: drawn by WebGL on a canvas that is not empty; its buttons hold, step, reject and stop."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from browser import PATIENCE, Browser

from evg_app.cli.main import main
from evg_app.errors import BadInput
from evg_app.trials import schema
from evg_app.trials.recorded import RecordedRun
from evg_app.trials.rows import read_rows
from evg_app.viewer.desk import EARLIEST
from evg_app.viewer.recorded import RecordedView, robot_of
from evg_app.viewer.window import Window

COLORS = 50
"""A scene has more colours than this; an empty canvas has one."""


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """Recorded while it was shown, with nobody looking."""
    folder = tmp_path_factory.mktemp("view") / "run"
    words = ["run", "--sim", "--model", "antipodal", "--seed", "100", "--run-dir", str(folder)]
    assert main([*words, "--view", "--view-port", "0"]) == 0
    return folder


@pytest.fixture
def browse(tmp_path):
    """Opens a URL in Chromium."""
    browsers = []

    def open_url(url: str) -> Browser:
        browsers.append(Browser(tmp_path / f"profile{len(browsers)}", url))
        return browsers[-1]

    yield open_url
    for browser in browsers:
        browser.close()


def client_of(window: Window):
    """The browser that looks at the window, once it has drawn."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        for client in window.server.get_clients().values():
            return client
        time.sleep(0.1)
    raise AssertionError("no browser came")


@pytest.mark.slow
def test_a_recorded_run_is_drawn_in_a_real_browser(run, browse):
    recorded = RecordedRun(run)
    with Window(robot_of(recorded), "0.0.0.0", 0) as window:
        RecordedView(window, recorded)
        browse(window.url.replace("0.0.0.0", "127.0.0.1"))
        client = client_of(window)
        begun = time.monotonic()
        while time.monotonic() < begun + PATIENCE:
            image = client.get_render(240, 320, transport_format="png", timeout=PATIENCE)
            if len(np.unique(image.reshape(-1, image.shape[2]), axis=0)) > COLORS:
                return
        raise AssertionError("the canvas stays empty")


@pytest.mark.slow
def test_every_pass_can_be_shown_and_a_label_from_the_view_counts(run):
    recorded = RecordedRun(run)
    with Window(robot_of(recorded), port=0) as window:
        view = RecordedView(window, recorded)
        before = window.counts
        for number in range(len(recorded.attempt_ids)):
            view.show(number)
            assert recorded.attempt(recorded.attempt_ids[number]).outcome in window.words
        view.label("success")
        assert window.counts != before, "the run has no success of its own"
        with pytest.raises(BadInput, match="--port"):
            Window(robot_of(recorded), port=int(window.server.get_port()))


@pytest.fixture
def live(tmp_path):
    """A run that waits for a person at the view; the process, its address, its folder."""
    folder = tmp_path / "run"
    words = ["run", "--sim", "--model", "antipodal", "--seed", "100", "--run-dir", str(folder)]
    seen = ["--view", "--view-port", "0", "--view-paused", "--confirm-grasps"]
    process = subprocess.Popen(
        [sys.executable, "-m", "evg_app.cli.main", *words, *seen],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    url = next(line for line in process.stdout if "live view" in line).split()[-1]
    yield process, url, folder
    process.kill()
    process.wait()


@pytest.mark.slow
def test_a_person_at_the_view_holds_steps_rejects_accepts_labels_and_stops(live, browse):
    process, url, folder = live
    page = browse(url)
    page.shows("held before 'look'")
    page.press("step")
    page.shows("held before 'observe'")
    page.press("go on")
    page.shows("execute the yellow grasp?")
    time.sleep(2 * EARLIEST)
    page.fill("why not", "too close to the edge")
    page.press("reject")
    page.shows("rejected by a person")
    time.sleep(2 * EARLIEST)
    page.press("accept")
    page.shows("1 passes")
    page.press("failure")
    page.shows("kept")
    page.shows("execute the yellow grasp?")
    page.press("stop")
    assert process.wait(PATIENCE) == 130, process.stdout.read()
    db = schema.open_existing(folder)
    said = [json.loads(row["data"]) for row in db.execute("SELECT data FROM events WHERE kind = 'GraspAnswered'")]
    held = [json.loads(row["data"])["state"] for row in db.execute("SELECT data FROM events WHERE kind = 'Held'")]
    db.close()
    assert [word["answer"]["reason"] for word in said] == ["too close to the edge", ""]
    assert held == ["look", "observe"] and [label.success for label in read_rows(folder).labels.values()] == [False]
    assert main(["trials", "replay", str(folder), "--all"]) == 0, "what was rejected is an input of the replay"
