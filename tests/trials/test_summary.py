"""What a recorded run says equals what happened, to the integer."""

import argparse
import json
import sqlite3

import numpy as np
import pytest
from picking_fakes import Lab

from evg_app.cli import trials as verb
from evg_app.errors import BadInput
from evg_app.events import Answer, AttemptFinished, Judged, RoundStarted
from evg_app.trials import arrays
from evg_app.trials.recorder import Recorder
from evg_app.trials.report import report
from evg_app.trials.schema import DATABASE, SCHEMA_VERSION, open_existing
from evg_app.trials.summary import summary

FACTS = {"git_commit": "c0ffee"}
"""Provenance of the tests: asking git takes time."""
NEEDED = {
    *("gsr", "dr", "successes", "attempts", "objects", "rounds", "picks_per_hour", "stop_reasons", "stage_ms", "seed"),
    *("model", "weights_sha256", "git_commit", "gsr_ci", "dr_ci", "confusion", "failure_reasons", "compute_ms"),
}


def record(folder, script="SFSMFF", objects=9, rounds=1, **more):
    lab = Lab(script=script, objects=objects, **more)
    with Recorder(folder, {"robot": {"name": "fake"}}, FACTS) as recorder:
        lab.listeners.append(recorder)
        result = lab.run(rounds=rounds)
    return lab, result


def test_the_summary_counts_what_happened(tmp_path):
    lab, result = record(tmp_path / "run", script="SFSMF")
    facts = summary(tmp_path / "run")
    assert set(facts) >= NEEDED
    assert (facts["successes"], facts["attempts"], facts["objects"], facts["rounds"]) == (2, 5, 9, 1)
    assert facts["gsr"] == 2 / 5 and facts["dr"] == 2 / 9
    assert facts["stop_reasons"] == {"two consecutive failures": 1}
    assert facts["failure_reasons"] == {"nothing held after lift": 2, "not in the bin": 1}
    assert facts["confusion"] == {"true_positive": 2, "false_positive": 1, "false_negative": 0, "true_negative": 2}
    assert (facts["seed"], facts["model"], facts["git_commit"]) == (0, "fake", "c0ffee")
    row = facts["round_rows"][0]
    assert (row["attempts"], row["successes"]) == (result.rounds[0].attempts, result.rounds[0].successes)
    spent = sum(e.motion_s + e.compute_ms / 1e3 for e in lab.of(AttemptFinished))
    assert facts["picks_per_hour"] == pytest.approx(3600 * 2 / spent, rel=1e-3)


def test_rows_of_rounds_add_up_to_the_run(tmp_path):
    lab, _ = record(tmp_path / "run", script="S" * 20, objects=2, rounds=3)
    facts = summary(tmp_path / "run")
    for key in ("attempts", "successes", "objects"):
        assert sum(row[key] for row in facts["round_rows"]) == facts[key]
    assert len(facts["round_rows"]) == facts["rounds"] == 3
    assert facts["attempts"] == sum(e.outcome.counts for e in lab.of(AttemptFinished)) == 6
    assert facts["stop_reasons"] == {"cleared": 3}


def test_without_a_grasp_there_is_no_attempt_but_a_pass(tmp_path):
    lab = Lab()
    lab.motion_planner.refuses = True
    with Recorder(tmp_path / "run", {}, FACTS) as recorder:
        lab.listeners.append(recorder)
        lab.run()
    facts = summary(tmp_path / "run")
    assert (facts["attempts"], facts["passes"], facts["gsr"]) == (0, 1, 0.0)
    assert facts["verdicts"] == {"ik": 3} and facts["compute_ms"]["median"] is None
    assert "0/0 = no trial" in report(facts)


def test_rounds_without_a_feasible_grasp_are_counted_where_the_planner_had_some(tmp_path):
    lab = Lab(script="SSSSS", objects=2)
    lab.motion_planner.refuses = True
    turn = iter([True, False, False])
    lab.listeners.append(
        lambda e: setattr(lab.motion_planner, "refuses", next(turn)) if isinstance(e, RoundStarted) else None
    )
    with Recorder(tmp_path / "run", {}, FACTS) as recorder:
        lab.listeners.append(recorder)
        lab.run(rounds=3)
    facts = summary(tmp_path / "run")
    assert (facts["no_feasible"]["rounds"], facts["no_feasible"]["of"]) == (1, 3)
    assert "no feasible grasp 1/3 = 33.3 %" in report(facts)


def test_the_arrays_of_an_attempt_are_what_the_loop_saw(tmp_path):
    lab, _ = record(tmp_path / "run", script="S", objects=1)
    judged = lab.of(Judged)[0]
    path = next((tmp_path / "run" / "attempts").glob("*.npz"))
    stored = arrays.read(path)
    assert stored["depth"].dtype == np.uint16 and (stored["depth"] == 500).all()
    assert stored["tsdf"].shape == stored["observed"].shape == (40, 40, 40)
    assert np.array_equal(stored["T_base_grasp"], judged.T_base_grasp)
    assert np.array_equal(stored["approach.q"], judged.trajectories["approach"].q)
    assert stored["verdict"].tolist() == ["accepted", "not examined", "not examined"]
    assert stored["chosen"] == 0 and stored["score"].tolist() == [0.9, 0.8, 0.7]
    needed = {"color", "depth_scale", "image_size", "focal_centre", "T_base_cam", "T_base_task", "q", "T_task_grasp"}
    assert needed <= set(stored)


def test_a_run_folder_holds_rows_arrays_pictures_a_film_and_a_summary(tmp_path):
    record(tmp_path / "run", script="SFS", objects=2)
    run = tmp_path / "run"
    db = open_existing(run)
    ids = [row[0] for row in db.execute("SELECT attempt_id FROM attempts")]
    assert len(set(ids)) == 3
    for attempt in ids:
        assert (run / "attempts" / f"{attempt}.npz").stat().st_size > 0
        assert (run / "attempts" / f"{attempt}.png").read_bytes().startswith(b"\x89PNG")
    assert (run / "run.gif").read_bytes().startswith(b"GIF89a")
    assert json.loads((run / "summary.json").read_text())["successes"] == 2
    assert json.loads((run / "run.json").read_text())["config"] == {"robot": {"name": "fake"}}
    kinds = [row[0] for row in db.execute("SELECT kind FROM events ORDER BY number")]
    assert (kinds[0], kinds[-1]) == ("RunStarted", "RunFinished") and "Verified" in kinds
    assert all(json.loads(row[0]) is not None for row in db.execute("SELECT data FROM events"))
    db.close()


def test_stats_prints_the_newest_run_and_writes_json(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    record(tmp_path / "runs" / "one", script="SFS", objects=2)
    parser = argparse.ArgumentParser()
    verb.add_parser(parser.add_subparsers())
    args = parser.parse_args(["trials", "stats", "--json", "out/stats.json"])
    assert args.run(args) == 0
    out = capsys.readouterr().out
    assert "GSR     2/3 = 66.7 % [20.8, 93.9]" in out and "DR      2/2 = 100.0 %" in out
    assert json.loads((tmp_path / "out/stats.json").read_text())["gsr"] == 2 / 3


def test_stats_without_a_run_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parser = argparse.ArgumentParser()
    verb.add_parser(parser.add_subparsers())
    for words in (["trials", "stats"], ["trials", "stats", "nowhere"]):
        args = parser.parse_args(words)
        with pytest.raises(BadInput, match="evg-app run"):
            args.run(args)


@pytest.mark.parametrize("content", [b"", b"not a database, but long enough to look like one" * 40])
def test_something_else_than_a_log_is_refused(tmp_path, content):
    (tmp_path / DATABASE).write_bytes(content)
    with pytest.raises(BadInput):
        summary(tmp_path)


def test_a_log_of_a_newer_program_is_refused(tmp_path):
    record(tmp_path / "run", script="S", objects=1)
    db = sqlite3.connect(tmp_path / "run" / DATABASE)
    db.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    db.close()
    with pytest.raises(BadInput, match="schema version"):
        summary(tmp_path / "run")


def test_the_comparison_of_two_runs_names_difference_tests_and_trials_needed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("evg_app.trials.compare.PERMUTATIONS", 1000)
    monkeypatch.setattr("evg_app.trials.bootstrap.NUMBERS", 4000)
    record(tmp_path / "a", script="S" * 40, objects=4, rounds=6)
    record(tmp_path / "b", script="SFSF" * 10 + "FF" * 40, objects=4, rounds=6)
    parser = argparse.ArgumentParser()
    verb.add_parser(parser.add_subparsers())
    words = ["trials", "compare", str(tmp_path / "a"), str(tmp_path / "b"), "--json", str(tmp_path / "c.json")]
    args = parser.parse_args(words)
    assert args.run(args) == 0
    facts, out = json.loads((tmp_path / "c.json").read_text()), capsys.readouterr().out
    gsr = facts["gsr"]
    assert gsr["a"][:2] == [24, 24] and gsr["same_rounds"] and gsr["difference"] > 0.4
    assert gsr["fisher_p"] < 0.01 and gsr["trials_needed_each"] >= 2
    assert gsr["sequential_attempts"]["steps"] == min(gsr["a"][1], gsr["b"][1])
    assert "permutation, paired by round" in out and "Newcombe" in out and "DR" in out
    assert verb_compare_lines(tmp_path / "a", tmp_path / "a")[-1].strip() == "nothing tells them apart"


def verb_compare_lines(a, b):
    from evg_app.trials.rows import read_rows
    from evg_app.trials.verdict import compare, lines

    return lines(compare(read_rows(a), read_rows(b)))


def test_the_tree_and_the_bootstrap_are_in_the_summary(tmp_path):
    record(tmp_path / "run", script="SFSMFFSSFF" * 4, objects=5, rounds=4)
    facts = summary(tmp_path / "run")
    low, high = facts["gsr_bootstrap_ci"]
    assert low <= facts["gsr"] <= high
    assert (
        facts["reason_tree"]["slip"]["leaves"]["nothing held after lift"]
        == facts["failure_reasons"]["nothing held after lift"]
    )
    assert facts["attempts_still_needed_for_5_percent"] > 0 and facts["operator"] is None
    assert "cluster bootstrap" in report(facts)


class Picky:
    """A person who rejects the first grasp of every pass."""

    asks = True

    def may_go_on(self, state, timeout):
        return True

    def judge(self, offered, timeout):
        return Answer(offered.index > 0, "too close")


def test_rates_with_a_person_who_rejects_grasps_say_so(tmp_path):
    lab = Lab(script="SS", objects=2, supervisor=Picky())
    with Recorder(tmp_path / "run", {}, {}) as recorder:
        lab.listeners.append(recorder)
        lab.run()
    facts = summary(tmp_path / "run")
    assert facts["successes"] == 2 and facts["verdicts"]["rejected by a person"] == 2
    assert "a person rejected 2 grasps" in report(facts)
