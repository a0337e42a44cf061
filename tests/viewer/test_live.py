"""The live view takes every event at once and never fails, whatever happens to the drawing."""

import threading
import time

import numpy as np
import pytest
from picking_fakes import Lab

from evg_app.events import AttemptFinished, AttemptOutcome, AttemptStarted, Evidence, GraspsPlanned, StateEntered
from evg_app.trials.recorder import Recorder
from evg_app.trials.rows import read_rows
from evg_app.trials.statistics import rate
from evg_app.types import Grasps
from evg_app.viewer.live import LiveView

PROMPT = 0.5
"""Taking 200 events while the drawing hangs, on a busy core [s]."""
PATIENCE = 10.0
FOUND = GraspsPlanned(Grasps(np.eye(4)[None], np.array([0.05]), np.array([0.5])))


def pass_events():
    yield AttemptStarted("a", 3, 1, 2, 0)
    yield StateEntered("plan")
    yield FOUND
    yield AttemptFinished("a", AttemptOutcome.FAILURE, False, None, "slipped", Evidence(), 1.0, 1.0)


def test_what_is_shown_last_is_what_happened_last():
    moments = []
    live = LiveView(moments.append)
    for event in pass_events():
        live(event)
    live.close(PATIENCE)
    assert moments[-1].words == ("seed 3, round 1, pass 2", "state: plan", "failure: slipped")
    assert any(m.stored is not None and len(m.stored["score"]) == 1 for m in moments), "the picture is never lost"


def test_a_window_that_hangs_never_stops_the_loop():
    stuck, moments = threading.Event(), []

    def hang(moment) -> None:
        moments.append(moment)
        stuck.wait(PATIENCE)

    live = LiveView(hang)
    begun = time.perf_counter()
    for _ in range(50):
        for event in pass_events():
            live(event)
    assert time.perf_counter() - begun < PROMPT
    stuck.set()
    live.close(PATIENCE)
    assert len(moments) <= 3, "what was not drawn in time is left out"


def test_a_window_that_breaks_is_logged_once_and_forgotten(caplog):
    def broken(_moment) -> None:
        raise ConnectionError("the browser died")

    live = LiveView(broken)
    for event in pass_events():
        live(event)
        time.sleep(0.01)
    live.close(PATIENCE)
    assert sum("cannot draw" in record.message for record in caplog.records) == 1


@pytest.mark.parametrize("event", ["no event", None])
def test_what_is_no_event_is_no_harm(event):
    live = LiveView(lambda _moment: None)
    live(event)
    live.close(PATIENCE)


def test_a_label_is_about_the_last_executed_grasp_and_is_kept_in_the_log(tmp_path):
    lab = Lab(script="SFF", objects=2)
    moments = []
    with Recorder(tmp_path / "run", {}, {}) as recorder:
        live = LiveView(moments.append, tmp_path / "run")
        assert "no grasp" in live.label(True)
        lab.listeners += [recorder, live]
        lab.run()
        assert "kept" in live.label(True)
    live.close(PATIENCE)
    rows = read_rows(tmp_path / "run")
    last = [row["attempt_id"] for row in rows.passes if row["counts"]][-1]
    assert rows.labels[last].success is True and not rows.labels[last].asked
    assert f"GSR {rate(rows.gsr_counts.k, rows.gsr_counts.n)}" in moments[-1].counts


def test_a_label_that_cannot_be_kept_is_said(tmp_path):
    live = LiveView(lambda _moment: None, tmp_path / "nowhere")
    live(AttemptFinished("a", AttemptOutcome.FAILURE, False, None, "slipped", Evidence(), 1.0, 1.0))
    assert "not kept" in live.label(True)
    live.close(PATIENCE)
