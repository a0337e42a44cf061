"""`evg-app calibrate --sim` with nothing handed over: rendered, detected, solved elsewhere, judged, verified."""

import json
import shutil

import numpy as np
import pytest

from evg_app.benchmark.calibration.units import Study, collected, judge, solved
from evg_app.cli.main import main
from evg_app.config.calibration import Calibration
from evg_app.config.files import load_robot, read
from evg_app.handeye import diagnose
from evg_app.handeye.sample import views_of
from evg_app.handeye.store import load_session
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.scene import empty_scene

TRUE_MM, TRUE_DEG = 3.0, 0.5
SAMPLES = "14"
VERIFY_S, LEAST_FRESH = 120, 7
SHOWN = 0.8


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """One calibration: its folder and its JSON."""
    folder = tmp_path_factory.mktemp("calibrate")
    target = folder / "out.json"
    words = ["--mode", "eye-to-hand", "--seed", "3", "--samples", SAMPLES, "--run-dir", str(folder / "run")]
    assert main(["calibrate", "--sim", *words, "--json", str(target)]) == 0
    return folder / "run", json.loads(target.read_text())


@pytest.mark.slow
def test_the_result_is_good_and_its_bound_holds(calibrated):
    _, facts = calibrated
    assert {"heldout_mm", "heldout_deg", "bound_mm", "true_mm", "true_deg", "samples", "verdict", "reasons"} <= set(
        facts
    )
    assert facts["verdict"] == "go", facts["reasons"]
    assert facts["true_mm"] < TRUE_MM and facts["true_deg"] < TRUE_DEG
    assert facts["true_mm"] < facts["bound_mm"]


@pytest.mark.slow
def test_the_run_folder_holds_result_report_and_samples(calibrated):
    folder, facts = calibrated
    result = read(folder / "result.yaml", Calibration)
    assert result.errors.samples == facts["samples"] and result.witness_error() < 1.0
    page = (folder / "report.html").read_text()
    assert "GO" in page and page.count("<img") == facts["taken"]
    assert (folder / "live.jpg").stat().st_size > 1000
    assert "true_mm" not in (folder / "facts.json").read_text(), "the solver knew the truth"


@pytest.mark.slow
def test_every_stop_is_free_of_collisions_shows_the_board_and_they_turn_about_all_axes(calibrated):
    planner = MotionPlanner(load_robot("panda"))
    session = load_session(calibrated[0])
    stops = np.stack([sample.q for sample in session.samples])
    assert not planner.checker.hits_scene(stops, empty_scene(planner.robot)).any()
    assert not any(planner.checker.self_collision.collides(q) for q in stops)
    assert len(session.usable()) >= SHOWN * len(stops)
    assert diagnose.rotations(views_of(session, session.usable()), session.mode) == []


@pytest.mark.slow
def test_stored_samples_solved_as_the_other_mode_are_refused_by_name(calibrated, tmp_path, capsys):
    folder, target = tmp_path / "copy", tmp_path / "again.json"
    shutil.copytree(calibrated[0], folder)
    assert main(["calibrate", "--from", str(folder), "--mode", "eye-in-hand", "--json", str(target)]) == 3
    facts = json.loads(target.read_text())
    assert "swapped-mode" in facts["causes"] and "--mode eye-to-hand" in " ".join(facts["reasons"])
    assert main(["calibrate", "--from", str(folder), "--mode", "eye-in-hand", "--force"]) == 0
    kept = read(folder / "result.yaml", Calibration)
    assert kept.forced and kept.verdict == "refuse" and kept.reasons


@pytest.mark.slow
def test_verify_agrees_with_the_lab_and_notices_another_one(calibrated, tmp_path, capsys):
    result = str(calibrated[0] / "result.yaml")
    verify = ["calibrate", "verify", "--sim", "--result", result, "--json", str(tmp_path / "v.json")]
    assert main([*verify, "--seed", "3"]) == 0
    found = json.loads((tmp_path / "v.json").read_text())
    assert found["mm"] < TRUE_MM and found["samples"] >= LEAST_FRESH
    assert found["seconds"] < VERIFY_S, "motions at the configured speed, rests and exposures"
    assert main([*verify, "--seed", "4"]) == 3


@pytest.mark.slow
def test_a_board_printed_too_large_is_named_and_corrected():
    facts, _ = solved(collected(Study(samples=14), "board-scale", "eye-in-hand", 3))
    assert "board-scale" in facts["causes"] and facts["board_scale"] == pytest.approx(1.03, abs=0.005)


@pytest.mark.slow
def test_intrinsics_that_are_wrong_are_named_and_corrected():
    session = Study(samples=14), "lens", "eye-to-hand", 3
    row = judge(*session, solved(collected(*session)))
    assert row.named and row.harmless and row.facts["verdict"] == "warn"
    assert row.facts["true_mm"] < row.facts["bound_mm"]
    assert min(v for v in row.plain_mm.values() if v) > TRUE_MM


@pytest.mark.slow
def test_a_grid_of_tags_calibrates_as_well_as_a_chessboard():
    session = Study(board="apriltag_a4", samples=14), "good", "eye-in-hand", 3
    row = judge(*session, solved(collected(*session)))
    assert row.facts["verdict"] == "go", row.facts["reasons"]
    assert row.facts["true_mm"] < TRUE_MM and row.facts["true_deg"] < TRUE_DEG
    assert row.facts["true_mm"] < row.facts["bound_mm"]


def test_without_a_mode_the_command_says_which_there_are(capsys):
    assert main(["calibrate", "--sim"]) == 2
    assert "--mode eye-to-hand" in capsys.readouterr().err
