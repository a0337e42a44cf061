"""A run folder is never overwritten, and what was finished survives a kill."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from picking_fakes import Lab

from evg_app.errors import BadInput
from evg_app.events import RunStarted, StateEntered
from evg_app.trials import arrays
from evg_app.trials.folder import make, newest
from evg_app.trials.provenance import canonical, git_commit, provenance, sha256
from evg_app.trials.recorder import Recorder
from evg_app.trials.schema import open_existing
from evg_app.trials.store import LogError, TrialStore
from evg_app.trials.summary import summary

PICKING = Path(__file__).parent.parent / "picking"


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


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_parent_is_bad_input(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(BadInput, match="cannot be written"):
        make(tmp_path / "run")


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


WRITER = """
    import sys
    from pathlib import Path
    sys.path.insert(0, {picking!r})
    from picking_fakes import Lab
    from evg_app.events import AttemptFinished
    from evg_app.trials.recorder import Recorder

    lab = Lab(script="S" * 100_000, objects=25)
    with Recorder(Path({folder!r}), {{}}, {{}}) as recorder:
        lab.listeners.append(recorder)
        def finished(event):
            if isinstance(event, AttemptFinished):
                sys.stdout.write(event.attempt_id + chr(10))
                sys.stdout.flush()
        lab.listeners.append(finished)
        lab.run(rounds=1000)
"""


@pytest.mark.parametrize("attempts", [1, 7])
def test_kill_9_loses_no_finished_attempt(tmp_path, attempts):
    folder = tmp_path / "run"
    code = textwrap.dedent(WRITER).format(picking=str(PICKING), folder=str(folder))
    writer = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert writer.stdout is not None
    finished = [writer.stdout.readline().strip() for _ in range(attempts)]
    os.kill(writer.pid, signal.SIGKILL)
    finished += [line.strip() for line in writer.stdout.read().splitlines() if line.strip()]
    writer.wait()
    db = open_existing(folder)
    assert db.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
    stored = {r[0]: r[1] for r in db.execute("SELECT attempt_id, arrays FROM attempts WHERE outcome IS NOT NULL")}
    db.close()
    assert set(finished) <= set(stored) and len(stored) <= len(finished) + 1
    for name in stored.values():
        assert "depth" in arrays.read(folder / name)
    facts = summary(folder)
    assert facts["attempts"] == len(stored) and facts["status"] == "interrupted"


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
