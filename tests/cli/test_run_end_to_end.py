"""The main job, end to end, nothing faked in between: `evg-app run --sim` with the shipped weights."""

import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evg_app.cli.main import main

PROMISED = {
    "gsr",
    "dr",
    "successes",
    "attempts",
    "objects",
    "rounds",
    "picks_per_hour",
    "stop_reasons",
    "stage_ms",
    "seed",
    "model",
    "weights_sha256",
    "git_commit",
}
"""What the JSON of a run has at least."""


def run(folder: Path, *words: str) -> dict:
    """One round in simulation; returns its JSON."""
    target = folder.parent / f"{folder.name}.json"
    assert main(["run", "--sim", "--run-dir", str(folder), "--json", str(target), *words]) == 0
    return json.loads(target.read_text())


@pytest.mark.slow
def test_a_table_of_unseen_objects_is_picked_and_everything_is_logged(tmp_path: Path, capsys):
    facts = run(tmp_path / "run", "--seed", "1")
    assert set(facts) >= PROMISED
    assert facts["successes"] >= 1
    assert facts["successes"] <= facts["attempts"]
    assert facts["gsr"] == facts["successes"] / facts["attempts"]
    assert facts["stage_ms"]["plan"]["median"] > 0
    folder = tmp_path / "run"
    log = sqlite3.connect(folder / "trials.sqlite")
    counted = log.execute("SELECT attempt_id FROM attempts WHERE counts = 1").fetchall()
    assert len(counted) == facts["attempts"]
    for (attempt,) in counted:
        with np.load(folder / "attempts" / f"{attempt}.npz") as arrays:
            assert arrays["depth"].dtype == np.uint16
            assert arrays["tsdf"].shape == (40, 40, 40)
        assert Image.open(folder / "attempts" / f"{attempt}.png").size[0] > 300
    assert getattr(Image.open(folder / "run.gif"), "n_frames", 1) > 10
    capsys.readouterr()
    assert main(["trials", "stats", str(folder)]) == 0
    assert f"{facts['successes']}/{facts['attempts']}" in capsys.readouterr().out


@pytest.mark.slow
def test_a_seed_reproduces_a_run_exactly(tmp_path: Path):
    first, second = (run(tmp_path / name, "--seed", "3", "--scene", "pile") for name in ("a", "b"))
    same = ("successes", "attempts", "objects", "stop_reasons", "outcomes", "verdicts", "motion_s")
    assert {key: first[key] for key in same} == {key: second[key] for key in same}
    files = [sorted((tmp_path / name / "attempts").glob("*.npz")) for name in ("a", "b")]
    assert len(files[0]) == len(files[1]) > 0
    for one, other in zip(*files, strict=True):
        with np.load(one) as a, np.load(other) as b:
            assert set(a.files) == set(b.files)
            for key in a.files:
                np.testing.assert_array_equal(a[key], b[key], err_msg=f"{one.name}: {key}")
