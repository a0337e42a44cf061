"""Replay of a real simulated run: identical, and one voxel, one weight byte or one config value is found out."""

import hashlib
import json
import shutil
import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evg_app.cli.main import main
from evg_app.cli.trials.playback import Playback
from evg_app.grasping.load import load_planner
from evg_app.grasping.weights import WEIGHTS_DIR
from evg_app.trials import arrays
from evg_app.trials.recorded import RecordedRun
from evg_app.trials.replay import ReplayStage, replay


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("replay") / "run"
    assert main(["run", "--sim", "--seed", "1", "--run-dir", str(folder)]) == 0
    return folder


@pytest.fixture
def run(recorded, tmp_path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "run"))


def first_stage(capsys) -> str:
    return capsys.readouterr().out.split("differs first in ")[1].splitlines()[0]


@pytest.mark.slow
def test_a_run_replays_to_the_bit(run, capsys):
    assert main(["trials", "replay", str(run), "--all"]) == 0
    n = len(RecordedRun(run).attempt_ids)
    assert n >= 1 and f"{n} of {n} attempts identical to the bit" in capsys.readouterr().out


@pytest.mark.slow
def test_one_voxel_is_found_in_perception(run, capsys):
    path = run / "attempts" / f"{RecordedRun(run).attempt_ids[-1]}.npz"
    stored = arrays.read(path)
    stored["volume_occupied"][2, 2, 2] ^= True
    np.savez_compressed(path, **stored)
    assert main(["trials", "replay", str(run)]) == 1
    assert first_stage(capsys) == "perception"


@pytest.mark.slow
def test_one_depth_value_changes_everything_after_it(run, capsys):
    path = run / "attempts" / f"{RecordedRun(run).attempt_ids[-1]}.npz"
    stored = arrays.read(path)
    v, u = np.unravel_index(np.argmax(stored["depth"] > 0), stored["depth"].shape)
    centre = tuple(n // 2 for n in stored["depth"].shape)
    at = centre if stored["depth"][centre] else (v, u)
    stored["depth"][at] -= 30
    np.savez_compressed(path, **stored)
    assert main(["trials", "replay", str(run)]) == 1
    assert first_stage(capsys) == "perception"


@pytest.mark.slow
def test_a_way_back_replays_to_the_bit_and_another_goal_is_found(run):
    log = RecordedRun(run)
    attempt = next(a for a in map(log.attempt, log.attempt_ids) if "back.q" in a.stored)
    session = log.sessions[attempt.run_id]

    def pipeline() -> Playback:
        return Playback(session.config, load_planner(session.model))

    above_bin, look = attempt.stored["back.q"][0], attempt.stored["back.q"][-1]
    ends = {"q_start": above_bin, "q_goal": look, "around_scene": np.array(True), "name": np.array("return")}
    asked = {f"routes.0.{name}": value for name, value in ends.items()}
    asked |= {f"routes.0.{name}": attempt.stored[f"back.{name}"] for name in ("q", "dq", "ddq", "dt", "joint_names")}
    ways = pipeline().recompute(replace(attempt, stored={**attempt.stored, **asked}))
    assert len(ways.routes) == 1 and (ways.routes[0].way.q[-1] == look).all()
    logged = {**attempt.stored, **{n: v for n, v in ways.arrays().items() if n.startswith("routes.")}}
    assert replay(replace(attempt, stored=logged), session, pipeline()).identical
    other = {**logged, "routes.0.q_goal": look + 0.01}
    assert replay(replace(attempt, stored=other), session, pipeline()).first is ReplayStage.ROUTES


@pytest.mark.slow
def test_one_byte_of_the_weights_is_found(run, tmp_path, capsys):
    for suffix in (".safetensors", ".json"):
        shutil.copy(WEIGHTS_DIR / f"equiigd{suffix}", tmp_path)
    weights = tmp_path / "equiigd.safetensors"
    data = bytearray(weights.read_bytes())
    data[len(data) // 2] ^= 1
    weights.write_bytes(data)
    words = ["trials", "replay", str(run), "--weights", str(weights)]
    assert main(words) == 1  # the card's hash refuses the file
    assert first_stage(capsys) == "weights"
    card = json.loads(weights.with_suffix(".json").read_text())
    card["sha256"] = hashlib.sha256(data).hexdigest()
    weights.with_suffix(".json").write_text(json.dumps(card))
    assert main(words) == 1  # the log's hash refuses it too
    assert first_stage(capsys) == "weights"


def reconfigure(folder: Path, forge_hash: bool) -> None:
    """Another lift height in the log, with the old hash or a forged one."""
    db = sqlite3.connect(folder / "trials.sqlite")
    config = json.loads(db.execute("SELECT config FROM runs").fetchone()[0])
    config["robot"]["lift_m"] += 0.001
    text = json.dumps(config, sort_keys=True, separators=(",", ":"))
    db.execute("UPDATE runs SET config = ?", (text,))
    if forge_hash:
        db.execute("UPDATE runs SET config_sha256 = ?", (hashlib.sha256(text.encode()).hexdigest(),))
    db.commit()
    db.close()


@pytest.mark.slow
@pytest.mark.parametrize(("forge_hash", "stages"), [(False, {"configuration"}), (True, {"feasibility", "motion"})])
def test_one_value_of_the_configuration_is_found(run, capsys, forge_hash, stages):
    reconfigure(run, forge_hash)
    assert main(["trials", "replay", str(run)]) == 1
    assert first_stage(capsys) in stages


@pytest.mark.slow
def test_another_model_says_what_it_would_have_done(run, capsys):
    assert main(["trials", "replay", str(run), "--model", "antipodal"]) == 0
    assert "antipodal would have picked in" in capsys.readouterr().out
