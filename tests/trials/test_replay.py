"""A replay says identical only when every bit is the same, and otherwise names the first stage that differs."""

import argparse
import json
import sqlite3
from dataclasses import replace

import numpy as np
import pytest
from picking_fakes import Lab, camera_config, robot

from evg_app.cli import trials as verb
from evg_app.cli.trials import replay as replay_verb
from evg_app.errors import BadInput, HardwareError, WeightsError
from evg_app.events import GraspsPlanned, Judged
from evg_app.geometry import translation
from evg_app.trials import arrays
from evg_app.trials.arrays import Gathered, frame_of, routes_of
from evg_app.trials.recorded import RecordedRun
from evg_app.trials.recorder import Recorder
from evg_app.trials.replay import ReplayStage, difference, environment_changes, replay
from evg_app.trials.schema import DATABASE
from evg_app.trials.what_if import apart, what_if
from evg_app.types import Grasps

ANGLE_ATOL = 1e-7
"""Arc cosine near 1 [rad]."""
FACTS = {"git_commit": "c0ffee", "packages": {"numpy": "1"}}


class FakePipeline:
    """The fake lab again: what it computed while recording, changed by `spoil`."""

    weights_sha256 = "0" * 64

    def __init__(self, spoil=None, judges=None):
        self.spoil, self.judges = spoil, judges

    def recompute(self, attempt):
        lab, gathered = Lab(objects=len(attempt.stored["depth"])), Gathered()
        lab.left = int(attempt.stored["points"]) // 1000
        taken = frame_of(attempt.stored)
        view = lab.perception.view(taken.frame, taken.q)
        from evg_app.events import Fused

        gathered.take(Fused(view.tsdf, view.points, view.depth_factor, view.volume))
        grasps = lab.planner.plan(view.tsdf)
        gathered.take(GraspsPlanned(grasps))
        d = lab.motion_planner.decide(grasps, taken.T_base_task, view, taken.q)
        gathered.take(Judged(d.verdicts, d.grasp_index, d.flipped, d.pick.T_base_grasp, d.pick.trajectories()))
        for route in routes_of(attempt.stored):
            gathered.take(replace(route, way=lab.motion_planner.route(route.q_start, route.q_goal, None)))
        if self.spoil is not None:
            self.spoil(gathered)
        return gathered

    def verified(self, attempt):
        return attempt.verified if self.judges is None else self.judges(attempt)


@pytest.fixture
def run(tmp_path):
    lab = Lab(script="SFS", objects=2)
    config = {"robot": robot().model_dump(mode="json"), "camera": camera_config().model_dump(mode="json")}
    with Recorder(tmp_path / "run", config, FACTS) as recorder:
        lab.listeners.append(recorder)
        lab.run()
    return tmp_path / "run"


def first(recorded, pipeline=None):
    attempt = recorded.attempt(recorded.attempt_ids[0])
    return replay(attempt, recorded.sessions[attempt.run_id], pipeline or FakePipeline())


def rewrite(folder, attempt_id, **changes):
    """Change arrays on the disk; `changes` are functions of the array."""
    path = folder / "attempts" / f"{attempt_id}.npz"
    stored = arrays.read(path)
    for name, change in changes.items():
        stored[name] = change(stored[name].copy())
    with path.open("wb") as stream:
        np.savez_compressed(stream, **stored)


def test_every_attempt_of_an_untouched_log_is_identical(run):
    recorded = RecordedRun(run)
    assert len(recorded.attempt_ids) == 3
    for name in recorded.attempt_ids:
        attempt = recorded.attempt(name)
        result = replay(attempt, recorded.sessions[attempt.run_id], FakePipeline())
        assert result.identical and result.first is None, result.differences
        assert {"tsdf", "volume_occupied", "score", "verdict", "approach.q"} <= set(result.compared)


def test_one_voxel_of_the_logged_grid_is_noticed(run):
    recorded = RecordedRun(run)

    def one(grid):
        grid[3, 4, 5] += 0.25
        return grid

    rewrite(run, recorded.attempt_ids[0], tsdf=one)
    result = first(recorded)
    assert result.first is ReplayStage.PERCEPTION
    assert "1 of 64000 values, largest difference 0.25" in result.differences[0].what
    assert result.differences[-1].stage is ReplayStage.LOG


def test_a_byte_that_no_stage_reads_is_noticed_by_the_file_s_hash(run):
    recorded = RecordedRun(run)
    rewrite(run, recorded.attempt_ids[0], color=lambda image: image + 1)
    assert first(recorded).first is ReplayStage.LOG


def test_other_weights_are_named_even_when_the_grasps_are_the_same(run):
    pipeline = FakePipeline()
    pipeline.weights_sha256 = "1" * 64
    assert first(RecordedRun(run), pipeline).first is ReplayStage.WEIGHTS


def test_one_config_value_is_noticed(run):
    db = sqlite3.connect(run / DATABASE)
    config = json.loads(db.execute("SELECT config FROM runs").fetchone()[0])
    config["robot"]["pregrasp_m"] += 1e-9
    db.execute("UPDATE runs SET config = ?", (json.dumps(config, sort_keys=True, separators=(",", ":")),))
    db.commit()
    db.close()
    assert first(RecordedRun(run)).first is ReplayStage.CONFIGURATION


def _flip_last_bit(array):
    flat = array.reshape(-1).view(np.uint8).copy()
    flat[0] ^= 1
    return flat.view(array.dtype).reshape(array.shape)


@pytest.mark.parametrize(
    ("stage", "spoil"),
    [
        (
            ReplayStage.PLANNING,
            lambda g: g.take(GraspsPlanned(replace(g.grasps, score=_flip_last_bit(g.grasps.score)))),
        ),
        (ReplayStage.FEASIBILITY, lambda g: g.take(replace(g.judged, flipped=True))),
        (
            ReplayStage.MOTION,
            lambda g: g.take(
                replace(
                    g.judged,
                    trajectories={
                        **g.judged.trajectories,
                        "lift": replace(g.judged.trajectories["lift"], dt=g.judged.trajectories["lift"].dt * 2),
                    },
                )
            ),
        ),
        (ReplayStage.PLANNING, lambda g: g.take(GraspsPlanned(Grasps.empty()))),
    ],
)
def test_the_first_stage_that_differs_is_named(run, stage, spoil):
    assert first(RecordedRun(run), FakePipeline(spoil)).first is stage


def test_a_way_back_that_is_another_and_a_judgement_that_is_another_are_named(run):
    recorded = RecordedRun(run)
    first_id = recorded.attempt_ids[0]
    attempt = recorded.attempt(first_id)
    assert len(routes_of(attempt.stored)) >= 1, "the arm was not at its look pose in the beginning"
    session = recorded.sessions[attempt.run_id]

    def another_way(gathered):
        gathered.routes[0] = replace(gathered.routes[0], way=gathered.judged.trajectories["reach"])

    assert replay(attempt, session, FakePipeline(another_way)).first is ReplayStage.ROUTES
    assert replay(attempt, session, FakePipeline(lambda g: g.routes.clear())).first is ReplayStage.ROUTES
    result = replay(attempt, session, FakePipeline(judges=lambda a: not a.verified))
    assert result.first is ReplayStage.VERIFICATION and "same evidence" in result.differences[0].what


def test_a_frame_that_the_loop_now_refuses_is_a_difference_in_perception(run):
    def refuse(_):
        raise HardwareError("too few pixels")

    result = first(RecordedRun(run), FakePipeline(refuse))
    assert result.first is ReplayStage.PERCEPTION and "too few pixels" in result.differences[0].what


def test_differences_tell_how_many_and_how_far():
    a = np.array([1.0, np.nan, 3.0])
    assert difference(a, a.copy()) == ""
    assert difference(a, np.array([1.0, np.nan, 3.5])) == "1 of 3 values, largest difference 0.5"
    assert difference(a, a[:2]) == "shape (3,) became (2,)"
    assert difference(a, a.astype(np.float32)) == "type float64 became float32"
    assert difference(np.array(["ik"], "U8"), np.array(["no path"], "U32")) == "1 of 1 entries"
    assert difference(None, a) == "not in the log" and difference(a, None) == "not computed any more"
    assert difference(np.array([0.0]), np.array([-0.0])) == "0 of 1 values, largest difference 0"


def test_what_changed_around_a_replay_is_listed():
    now = {"git_commit": "beef", "packages": {"numpy": "2", "torch": "3"}}
    changes = environment_changes(FACTS, now)
    assert changes == ["git_commit: c0ffee became beef", "numpy: 1 became 2", "torch: absent became 3"]


def command(*words):
    parser = argparse.ArgumentParser()
    verb.add_parser(parser.add_subparsers())
    args = parser.parse_args(["trials", *map(str, words)])
    return args.run(args)


def test_the_verb_exits_0_only_when_all_are_identical(run, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(replay_verb, "_pipeline", lambda *_: FakePipeline())
    assert command("replay", run, "--all", "--json", tmp_path / "out.json") == 0
    assert "3 of 3 attempts identical to the bit" in capsys.readouterr().out
    assert json.loads((tmp_path / "out.json").read_text())["identical"] == 3
    rewrite(run, RecordedRun(run).attempt_ids[1], score=_flip_last_bit)
    assert command("replay", run, "--all") == 1
    out = capsys.readouterr().out
    assert "differs first in planning" in out and "2 of 3" in out
    assert command("replay", run) == 0
    with pytest.raises(BadInput, match="no attempt begins with 'nope'"):
        command("replay", run, "--attempt", "nope")


def test_weights_that_cannot_be_loaded_are_the_first_difference(run, monkeypatch, capsys):
    def broken(*_):
        raise WeightsError("corrupt or truncated")

    monkeypatch.setattr(replay_verb, "_pipeline", broken)
    assert command("replay", run) == 1
    assert "differs first in weights" in capsys.readouterr().out


def test_what_another_model_would_have_done_is_told_beside_what_was_done(run):
    recorded = RecordedRun(run)
    found = what_if(recorded.attempt(recorded.attempt_ids[0]), FakePipeline())
    assert found.would_pick and found.candidates == 3
    assert found.distance_m == pytest.approx(0.0) and found.angle_rad == pytest.approx(0.0, abs=ANGLE_ATOL)
    assert "would pick with score 0.90" in found.line()


def test_the_antipodal_twin_is_the_same_grasp():
    a = translation(0.1, 0.2, 0.3)
    twin = a @ np.diag([-1.0, -1.0, 1.0, 1.0])
    assert apart(a, twin) == pytest.approx((0.0, 0.0), abs=ANGLE_ATOL)
    assert apart(a, a @ translation(0.0, 0.0, 0.02))[0] == pytest.approx(0.02)


def test_missing_arrays_are_bad_input_that_names_the_attempt(run):
    recorded = RecordedRun(run)
    (run / "attempts" / f"{recorded.attempt_ids[0]}.npz").write_bytes(b"torn")
    with pytest.raises(BadInput, match=recorded.attempt_ids[0]):
        recorded.attempt(recorded.attempt_ids[0])
