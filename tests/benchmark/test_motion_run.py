"""The motion benchmark on real scenes: true views, contacts of PyBullet, pure and resumable units."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evg_app.benchmark.motion import run as running
from evg_app.benchmark.motion.baseline import StraightPick
from evg_app.benchmark.motion.cell import Cell
from evg_app.benchmark.motion.config import MotionBenchmark, kind_of
from evg_app.benchmark.motion.row import BASELINE, TIMES, TRUE, SceneRow
from evg_app.benchmark.motion.run import benchmark, journal_path
from evg_app.benchmark.motion.targets import targets_of
from evg_app.benchmark.motion.truth import TrueDistance, true_view
from evg_app.cli.main import main
from evg_app.errors import BadInput
from evg_app.geometry import transform_points
from evg_app.motion.kinematics import Kinematics, hand_of_grasp
from evg_app.motion.path import line
from evg_app.motion.scene import surface_points
from evg_app.motion.trajectory import time_path

SMALL = MotionBenchmark(count=1, candidates=400, reach=1, seeds=20, examined=4)
SURFACE = 0.002
"""The true grid's zero crossings lie this close to the meshes [m]: a fraction of its voxels."""


@pytest.fixture(scope="module")
def cell():
    with Cell(dataclasses.replace(SMALL, count=3), 0, 0) as opened:
        yield opened


def test_a_third_of_the_scenes_is_of_each_kind() -> None:
    assert [kind_of(k) for k in range(4)] == ["packed", "pile", "adversarial", "packed"]


def test_the_true_view_is_the_meshes(cell: Cell) -> None:
    state = cell.state()
    view, distance = true_view(state, cell.T_base_task), TrueDistance(state)
    points = surface_points(view.tsdf)
    objects = points[points[:, 2] > 0.05 + 2 * SURFACE]
    assert len(objects) > 100 and np.abs(distance.at(objects)).max() < SURFACE
    centers = view.volume.origin + (np.argwhere(view.volume.occupied) + 0.5) * view.volume.voxel_size
    in_task = (centers - cell.T_base_task[:3, 3]) @ cell.T_base_task[:3, :3]
    assert np.abs(distance.at(in_task)).max() < view.volume.voxel_size * np.sqrt(3)


def test_targets_are_grasps_of_every_object_that_takes_turns(cell: Cell) -> None:
    targets = targets_of(cell.state(), 800, np.random.default_rng(0))
    assert len(targets) > 0 and (targets.width > 0).all()
    first = targets.owner[targets.spread(2)]
    assert len(set(first.tolist())) == min(2, len(set(targets.owner.tolist())))


def test_driving_the_hand_into_an_object_is_a_contact_with_its_name(cell: Cell) -> None:
    kinematics, q = Kinematics(cell.robot), cell.q()
    thing = cell.state().objects[0]
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = transform_points(cell.T_base_task, thing.T_task_object[:3, 3])
    T[2, 3] += 0.25
    above = kinematics.ik(hand_of_grasp(cell.robot, T), q)
    T[2, 3] -= 0.20
    inside = kinematics.ik(hand_of_grasp(cell.robot, T), above)
    crash = StraightPick(time_path(line(q, above), cell.robot), time_path(line(above, inside), cell.robot))
    as_target = cell.execute(crash, 0)
    assert as_target.target_before and not any("0:" in c.other for c in as_target.before)
    as_other = cell.execute(crash, len(cell.state().objects) - 1)
    touched = [c for c in as_other.before if c.other == f"0:{thing.name}"]
    assert [c.phase for c in touched][:1] == ["approach"] and touched[0].time > crash.reach.duration
    stay = StraightPick(time_path(line(q, above), cell.robot), time_path(line(above, above), cell.robot))
    again = cell.execute(stay, 0)
    assert again.before == () and not again.target_before and again.ended == "done", (
        "every pick begins from the same state"
    )


@pytest.fixture(scope="module")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("motion") / "m.json"
    target.write_text(json.dumps(benchmark(SMALL, 0, 1, json_path=target)))
    return target


@pytest.mark.slow
def test_a_scene_is_a_pure_function_of_config_seed_and_number(small_run: Path) -> None:
    times: dict[str, Any] = dict.fromkeys(TIMES, ()) | {"git_commit": ""}
    first = SceneRow.from_dict(json.loads(small_run.read_text())["rows"][0])
    again = SceneRow.from_dict(benchmark(SMALL, 0, 1)["rows"][0])
    assert dataclasses.replace(first, **times) == dataclasses.replace(again, **times)


@pytest.mark.slow
def test_every_arm_of_the_experiment_moves_and_the_planner_breaks_no_limit(small_run: Path) -> None:
    facts = json.loads(small_run.read_text())
    assert facts["executed"] >= 1 and facts["arms"][BASELINE]["executed"] >= 1 and facts["executed_observed"] >= 1
    assert facts["limit_violations"] == 0 and facts["arms"][TRUE]["worst_ratios"]["velocity"] > 0.5
    assert facts["scenes"] == 1 and facts["git_commit"]


@pytest.mark.slow
def test_finished_scenes_are_not_run_again_and_other_settings_are_refused(
    small_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> SceneRow:
        raise AssertionError("this scene is in the journal")

    monkeypatch.setattr(running, "run_scene", never)
    assert benchmark(SMALL, 0, 1, json_path=small_run)["scenes"] == 1
    assert len(journal_path(small_run).read_text().splitlines()) == 2
    with pytest.raises(BadInput, match="other settings"):
        benchmark(dataclasses.replace(SMALL, count=3), 0, 1, json_path=small_run)
    with pytest.raises(BadInput, match="other settings"):
        benchmark(SMALL, 1, 1, json_path=small_run)


def test_bad_numbers_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(BadInput, match="at least 1"):
        MotionBenchmark(reach=0)
    with pytest.raises(BadInput, match="at least one scene"):
        benchmark(SMALL, 0, 0)
    assert main(["benchmark", "motion", "--robot", "nothing", "--scenes", "1"]) == 2
    assert "available" in capsys.readouterr().err
