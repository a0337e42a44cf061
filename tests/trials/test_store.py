"""A run folder is never overwritten, and what was finished survives a kill."""

import json
import os
import re
import shutil
import sqlite3
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from kill_harness import kill_often
from picking_fakes import LOOK, Lab

from evg_app.errors import BadInput
from evg_app.events import AttemptFinished, DevicesConnected, RunFinished, RunStarted, StateEntered, Warned
from evg_app.trials import arrays, schema
from evg_app.trials.folder import make, newest
from evg_app.trials.labels import VIEWER, add_label
from evg_app.trials.page import page
from evg_app.trials.provenance import canonical, git_commit, provenance, sha256
from evg_app.trials.recorder import Recorder
from evg_app.trials.rows import read_rows
from evg_app.trials.schema import DATABASE, FIRST_TABLES, SCHEMA_VERSION, open_existing
from evg_app.trials.store import LogError, TrialStore
from evg_app.trials.summary import summary

KILLS = 8
"""In the tests; 200 in docs/trials.md."""


def test_a_folder_with_content_is_refused_and_untouched(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(BadInput, match="not empty"):
        Recorder(tmp_path, {}, {})
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_an_empty_folder_is_taken(tmp_path):
    assert make(tmp_path) == tmp_path and (tmp_path / "attempts").is_dir()


def test_a_place_that_cannot_be_written_is_bad_input(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot be written"):
        make(tmp_path / "file" / "run")


@contextmanager
def nobody():
    """As a user who owns nothing, when the tests run as root; as the user otherwise."""
    is_root = os.geteuid() == 0
    if is_root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if is_root:
            os.seteuid(0)


def test_a_read_only_parent_is_bad_input():
    with tempfile.TemporaryDirectory() as parent:
        Path(parent).chmod(0o555)
        with nobody(), pytest.raises(BadInput, match="Permission denied"):
            make(Path(parent) / "run")


def test_a_parent_that_the_system_mounts_read_only_is_bad_input():
    with pytest.raises(BadInput, match="cannot be written"):
        make(Path("/proc/evg-app-run"))


def test_the_newest_run_is_the_one_written_last(tmp_path):
    for name, age in (("b", 1), ("a", 2), ("c", 0)):
        TrialStore(make(tmp_path / name), {}, {}).close()
        os.utime(tmp_path / name / "trials.sqlite", (1000 + age, 1000 + age))
    assert newest(tmp_path).name == "a"


def test_arrays_are_there_whole_or_not_at_all(tmp_path, monkeypatch):
    def torn(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(arrays.os, "fsync", torn)
    with pytest.raises(OSError, match="No space"):
        arrays.write(tmp_path / "a.npz", arrays.Gathered())
    assert not (tmp_path / "a.npz").exists()


def test_a_full_disk_while_arrays_are_written_stops_the_run_and_keeps_the_log_readable(tmp_path, monkeypatch):
    lab, fsync, calls = Lab(script="SSSS", objects=4), os.fsync, []

    def full(descriptor):
        calls.append(1)
        if len(calls) > 2 * 3:  # file and folder of run.json, the first attempt's arrays and its picture
            raise OSError(28, "No space left on device")
        fsync(descriptor)

    monkeypatch.setattr(arrays.os, "fsync", full)
    with Recorder(tmp_path / "run", {}, {}) as recorder:
        lab.listeners.append(recorder)
        result = lab.run()
    assert isinstance(result.error, LogError) and result.exit_code == 4
    assert "No space left" in str(result.error)
    assert summary(tmp_path / "run")["successes"] == 1


def test_what_the_devices_said_of_themselves_is_in_the_provenance(tmp_path):
    devices = {"camera": {"driver": "realsense", "serial": "77", "firmware": "5.17"}, "arm": {"driver": "fci"}}
    with Recorder(tmp_path / "run", {}, {"machine": "here"}) as recorder:
        recorder(DevicesConnected(devices))
        recorder(RunStarted((0,), 1, "none", ""))
        recorder(RunFinished("finished"))
    row = json.loads((tmp_path / "run" / "run.json").read_text())
    assert row["provenance"] == {"machine": "here", "devices": devices}
    assert "serial 77" in page(read_rows(tmp_path / "run"))


def test_an_interrupted_run_still_has_numbers(tmp_path):
    lab = Lab(script="SSS", objects=3)
    with Recorder(tmp_path / "run", {}, {}) as recorder:
        lab.listeners.append(recorder)
        lab.planner.hook = lambda: 1 / 0 if len(lab.planner.seeds) > 2 else None
        with pytest.raises(ZeroDivisionError):
            lab.run()
    facts = summary(tmp_path / "run")
    assert (facts["successes"], facts["status"]) == (2, "error")
    assert facts["stop_reasons"] == {"error": 1}


def test_kill_9_at_random_moments_corrupts_nothing_and_loses_no_finished_attempt():
    found = kill_often(KILLS, seed=1)
    assert found.kills == KILLS and found.attempts > 0
    assert found.corrupt == found.lost == found.too_many == []


def stopped_by_the_log(tmp_path, spoil):
    """A run whose log is spoiled after the first attempt; returns the lab, the result and the folder."""
    lab = Lab(script="SSSSSSSS", objects=8)
    with Recorder(tmp_path / "run", {}, {}) as recorder:
        lab.listeners.append(recorder)

        def after_the_first(event):
            if isinstance(event, AttemptFinished) and not lab.of(Warned):
                once(recorder)

        done = []

        def once(recorder):
            if not done:
                done.append(spoil(recorder.store))

        lab.listeners.append(after_the_first)
        result = lab.run()
    return lab, result, tmp_path / "run"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda store: store._db.execute("PRAGMA max_page_count = 1"), "database or disk is full"),
        (lambda store: store._db.execute("PRAGMA query_only = ON"), "readonly"),
        (lambda store: _no_folder(store.folder), "No such file|Not a directory"),
    ],
    ids=["disk full", "read-only", "folder gone"],
)
def test_a_log_that_cannot_be_written_is_reported_while_the_arm_ends_at_rest(tmp_path, spoil, words):
    lab, result, folder = stopped_by_the_log(tmp_path, spoil)
    assert isinstance(result.error, LogError) and result.exit_code == 4
    assert re.search(words, str(result.error)) and "--resume" in str(result.error)
    assert np.allclose(lab.arm.q, LOOK, atol=0.02), "the arm went back to its look pose"
    assert lab.gripper.width > 0.05, "the object in hand was not left there"
    assert lab.binned == 2, "the second attempt was finished, none began after it"
    assert summary(folder)["attempts"] == 1, "the finished attempt is still in the log"


def _no_folder(folder):
    shutil.rmtree(folder / "attempts")
    (folder / "attempts").write_bytes(b"")


def test_events_of_an_attempt_in_progress_are_lost_whole_not_in_part(tmp_path):
    store = TrialStore(make(tmp_path / "run"), {}, {})
    store(RunStarted((0,), 1, "fake", ""))
    store(StateEntered("look"))
    db = open_existing(tmp_path / "run")
    assert db.execute("SELECT COUNT(*) FROM events").fetchone()[0] == 1
    db.close()
    store.close()
    store.close()


def test_provenance_says_where_numbers_come_from(tmp_path):
    facts = provenance()
    assert facts["packages"]["numpy"] and facts["command"] and facts["python"].startswith("3.")
    assert git_commit(tmp_path) == "unknown" or len(git_commit(tmp_path)) >= 40


def test_the_config_hash_depends_on_values_not_on_order():
    a, b = {"x": 1, "y": [1, 2]}, {"y": [1, 2], "x": 1}
    assert sha256(canonical(a)) == sha256(canonical(b)) != sha256(canonical({"x": 2, "y": [1, 2]}))


def first_version(folder):
    """A log as schema version 1 wrote it, with one attempt."""
    db = sqlite3.connect(folder / DATABASE)
    db.executescript(FIRST_TABLES)
    db.execute("PRAGMA user_version = 1")
    db.execute("INSERT INTO runs VALUES ('r', 't', 't', 'finished', '', '[0]', 1, 'm', '', '{}', 'x', '{}')")
    db.execute("INSERT INTO rounds VALUES ('r', 0, 0, 3, 'cleared', '')")
    row = "'a', 'r', 0, 0, 0, 1, 'success', 1, 1, 1, '', '{}', 2.0, 3.0, 5, 0, 0, 0.9, 0.05, 'attempts/a.npz'"
    db.execute(f"INSERT INTO attempts VALUES ({row})")
    db.commit()
    db.close()
    return folder


def test_an_old_log_is_read_without_being_changed(tmp_path):
    folder = first_version(tmp_path)
    before = (folder / DATABASE).read_bytes()
    facts = summary(folder)
    assert (facts["successes"], facts["attempts"], facts["protocol"]) == (1, 1, None)
    assert (folder / DATABASE).read_bytes() == before


def test_an_old_log_is_migrated_where_it_lies_when_something_is_added(tmp_path):
    folder = first_version(tmp_path)
    add_label(folder, "a", False)
    facts = summary(folder)
    assert facts["successes"] == 0 and facts["operator"]["gsr_automatic"] == 1.0
    db = sqlite3.connect(folder / DATABASE)
    assert db.execute("PRAGMA user_version").fetchone()[0] == SCHEMA_VERSION
    db.close()


def test_a_migrated_log_has_the_tables_of_a_new_one(tmp_path):
    def tables(db):
        return sorted(row[0] for row in db.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL"))

    old = first_version(tmp_path)
    new = tmp_path / "new"
    new.mkdir()
    schema.create(new).close()
    add_label(old, "a", None)
    a, b = (sqlite3.connect(folder / DATABASE) for folder in (old, new))
    assert tables(a) == tables(b)
    a.close()
    b.close()


def test_labels_may_be_written_by_somebody_else_while_a_run_goes_on(tmp_path):
    lab = Lab(script="SSS", objects=3)
    with Recorder(tmp_path / "run", {}, {}) as recorder:
        lab.listeners.append(recorder)
        said = []

        def from_outside(event):
            if isinstance(event, StateEntered) and event.state == "lift" and lab.of(AttemptFinished):
                attempt = lab.of(AttemptFinished)[-1].attempt_id
                add_label(tmp_path / "run", attempt, False, VIEWER)
                said.append(attempt)

        lab.listeners.append(from_outside)
        lab.run()
    facts = summary(tmp_path / "run")
    assert len(said) == 2 and facts["operator"]["labelled"] == 2 and facts["successes"] == 1
    with pytest.raises(BadInput, match="has no attempt 'nobody'"):
        add_label(tmp_path / "run", "nobody", True)
