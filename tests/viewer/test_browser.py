"""The view in a real browser: a recorded run, through the token, drawn by WebGL on a canvas that is not empty."""

import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from evg_app.cli.main import main
from evg_app.errors import BadInput
from evg_app.trials.recorded import RecordedRun
from evg_app.viewer.recorded import RecordedView, robot_of
from evg_app.viewer.window import Window

PATIENCE = 150
"""For a browser without a GPU on a busy core to load the page, and again to draw it [s]."""
COLORS = 50
"""A scene has more colours than this; an empty canvas has one."""
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--window-size=800,600",
    "--remote-debugging-port=0",
)


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
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    assert chromium, "this test needs a browser: apt-get install chromium"
    browsers = []

    def open_url(url: str) -> None:
        words = [chromium, *FLAGS, f"--user-data-dir={tmp_path}", url]
        browsers.append(subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))

    yield open_url
    for browser in browsers:
        browser.terminate()
        browser.wait(timeout=30)


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
