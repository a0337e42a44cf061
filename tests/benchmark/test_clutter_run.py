"""Whole benchmarks on built-in objects: pure rounds, own streams, resuming, comparing."""

import dataclasses
import json
import logging
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from evg_app.benchmark.clutter import run as running
from evg_app.benchmark.clutter.compare import compare
from evg_app.benchmark.clutter.config import VIEWS, BenchmarkConfig
from evg_app.benchmark.clutter.rounds import RoundResult, run_round
from evg_app.benchmark.clutter.run import benchmark, journal_path
from evg_app.benchmark.clutter.table import ClutteredTable
from evg_app.benchmark.clutter.view import observe
from evg_app.benchmark.journal import Journal
from evg_app.cli import benchmark_clutter as command
from evg_app.cli.main import main
from evg_app.errors import BadInput, UnknownName
from evg_app.geometry import WORKSPACE_SIZE, invert
from evg_app.grasping.load import MODELS
from evg_app.perception.tsdf import fuse_depth
from evg_app.simulation.noise import NOISE_MODELS
from evg_app.simulation.recipes import KINDS
from evg_app.simulation.rendering import SceneCaster
from evg_app.simulation.state import SceneState

CONFIG = BenchmarkConfig(scene="packed", model="random", count=2)
GRID_TOLERANCE = 1e-6
ROW = 0.0025
"""What one image row can change at the side view, in grid values over a band of 60 mm [share], at the median."""


def without_times(row: RoundResult) -> RoundResult:
    return dataclasses.replace(row, plan_ms=())


def test_round_is_a_pure_function_of_config_seed_and_number() -> None:
    planner = CONFIG.planner()
    first, again, other = (run_round(CONFIG, planner, 3, number) for number in (1, 1, 2))
    assert without_times(first) == without_times(again)
    assert without_times(first) != without_times(other)


def test_scene_does_not_depend_on_planner_view_or_noise() -> None:
    other = dataclasses.replace(CONFIG, model="antipodal", view="random", noise="none")
    rows = [run_round(c, c.planner(), 0, 0) for c in (CONFIG, other)]
    assert rows[0].names == rows[1].names


@pytest.mark.parametrize("scene", ["packed", "pile", "adversarial"])
def test_scene_lies_at_rest_inside_the_cube(scene: str) -> None:
    config = dataclasses.replace(CONFIG, scene=scene, count=3)
    with ClutteredTable(config, config.object_models(), np.random.default_rng(0)) as table:
        before = table.state()
        table.remove_and_rest()
        after = table.state()
    assert 1 <= len(before.objects) <= 3
    for a, b in zip(before.objects, after.objects, strict=True):
        p = a.T_task_object[:3, 3]
        assert (p > -0.05).all() and (p < WORKSPACE_SIZE + 0.05).all()
        assert np.linalg.norm(p - b.T_task_object[:3, 3]) < 0.005


def test_observation_is_the_whole_image_one_row_off() -> None:
    config = dataclasses.replace(CONFIG, noise="none")
    with ClutteredTable(config, config.object_models(), np.random.default_rng(1)) as table:
        state = table.state()
    seen = observe(config, state, np.random.default_rng(0), np.random.default_rng(0))
    whole = SceneCaster(state).depth(config.intrinsics, seen.T_task_cam)
    off = np.roll(whole, -1, axis=0)
    expected = fuse_depth(off, config.intrinsics, invert(seen.T_task_cam)).values
    same = np.abs(seen.values - expected) < 1e-3
    assert same.mean() > 0.999
    straight = fuse_depth(whole, config.intrinsics, invert(seen.T_task_cam)).values
    band = (straight > 0) & (seen.values > 0)
    assert np.median(np.abs(seen.values - straight)[band]) > ROW
    assert not seen.empty


def test_bare_table_is_an_empty_view() -> None:
    config = dataclasses.replace(CONFIG, noise="gaussian")
    seen = observe(config, SceneState(()), np.random.default_rng(0), np.random.default_rng(0))
    assert seen.empty and seen.values.any()


def test_table_as_ruler_undoes_a_global_depth_error() -> None:
    raw = dataclasses.replace(CONFIG, noise="gamma")
    ruled = dataclasses.replace(raw, table_ruler=True)
    with ClutteredTable(raw, raw.object_models(), np.random.default_rng(1)) as table:
        state = table.state()
    clean, noisy, mended = (
        observe(c, state, np.random.default_rng(0), np.random.default_rng(4)).values
        for c in (dataclasses.replace(raw, noise="none"), raw, ruled)
    )
    table_top = (slice(30, 38), slice(4, 36), slice(4, 10))
    error = [np.abs(v[table_top] - clean[table_top]).mean() for v in (noisy, mended)]
    assert error[1] < 0.5 * error[0]


def test_benchmark_resumes_and_repairs_an_interrupted_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    target = tmp_path / "r.json"
    first = benchmark(CONFIG, [0], 2, json_path=target)
    journal = journal_path(target)
    journal.write_text(journal.read_text()[:-20])
    played: list[tuple[int, int]] = []
    original = run_round

    def counted(config: BenchmarkConfig, planner: object, seed: int, number: int, commit: str) -> RoundResult:
        played.append((seed, number))
        return original(config, planner, seed, number, commit)  # type: ignore[arg-type]

    monkeypatch.setattr(running, "run_round", counted)
    with caplog.at_level(logging.WARNING):
        second = benchmark(CONFIG, [0], 3, json_path=target)
    assert played == [(0, 1), (0, 2)]
    assert "broken line" in caplog.text
    assert second["rounds"] == 3 and len(journal.read_text().splitlines()) == 4
    plain = [{k: v for k, v in row.items() if k not in ("plan_ms", "git_commit")} for row in first["rows"]]
    assert plain == [{k: v for k, v in r.items() if k not in ("plan_ms", "git_commit")} for r in second["rows"][:2]]


def test_rounds_of_other_settings_are_not_mixed(tmp_path: Path) -> None:
    benchmark(CONFIG, [0], 1, json_path=tmp_path / "r.json")
    with pytest.raises(BadInput, match="other settings"):
        benchmark(dataclasses.replace(CONFIG, noise="none"), [0], 1, json_path=tmp_path / "r.json")


@pytest.mark.slow
def test_two_processes_give_what_one_gives() -> None:
    alone, together = (benchmark(CONFIG, [0, 1], 1, workers=n) for n in (1, 2))
    for facts in (alone, together):
        for row in facts["rows"]:
            row.pop("plan_ms")
    assert alone["rows"] == together["rows"]


def test_commands_write_and_compare_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a, b, difference = tmp_path / "a.json", tmp_path / "b.json", tmp_path / "d.json"
    common = ["benchmark", "clutter", "--count", "2", "--rounds", "1", "--workers", "1"]
    assert main([*common, "--model", "random", "--json", str(a)]) == 0
    assert main([*common, "--model", "antipodal", "--json", str(b)]) == 0
    facts = json.loads(a.read_text())
    wanted = "gsr dr gsr_ci dr_ci successes attempts cleared objects rounds plan_ms_median model weights_sha256 seeds"
    assert set(wanted.split()) | {"git_commit", "rows"} <= facts.keys()
    assert facts["rounds"] == len(facts["rows"]) == 1 and facts["seeds"] == [0] and facts["model"] == "random"
    assert main(["benchmark", "compare", str(a), str(b), "--json", str(difference)]) == 0
    assert "B - A" in capsys.readouterr().out
    assert json.loads(difference.read_text())["rounds"] == 1


def test_results_of_other_scenes_are_not_compared(tmp_path: Path) -> None:
    for name, view in (("a", "side"), ("b", "random")):
        config = dataclasses.replace(CONFIG, view=view)
        (tmp_path / f"{name}.json").write_text(json.dumps(benchmark(config, [0], 1)))
    with pytest.raises(BadInput, match="view is side in the first and random"):
        compare(tmp_path / "a.json", tmp_path / "b.json")
    with pytest.raises(BadInput, match="cannot be read"):
        compare(tmp_path / "nothing.json", tmp_path / "b.json")
    (tmp_path / "c.json").write_text("[]")
    with pytest.raises(BadInput, match="not a result"):
        compare(tmp_path / "a.json", tmp_path / "c.json")


def test_bad_names_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UnknownName, match="view"):
        BenchmarkConfig(view="top")
    assert main(["benchmark", "clutter", "--model", "nothing"]) == 2
    assert "available" in capsys.readouterr().err


def test_command_offers_exactly_what_the_benchmark_knows() -> None:
    assert set(command.SCENES) == set(KINDS)
    assert set(command.NOISES) == set(NOISE_MODELS)
    assert set(command.VIEWS) == set(VIEWS)
    assert all(name in command.MODELS for name in MODELS)


def test_two_processes_cannot_write_one_journal(tmp_path: Path) -> None:
    path = tmp_path / "result.rounds.jsonl"
    first = Journal(path, {"digest": "a"}, RoundResult)
    code = (
        "import sys; from pathlib import Path; from evg_app.benchmark.journal import Journal\n"
        "from evg_app.benchmark.clutter.rounds import RoundResult; from evg_app.errors import BadInput\n"
        "try: Journal(Path(sys.argv[1]), {'digest': 'a'}, RoundResult)\n"
        "except BadInput as error: print(error)\n"
        "else: print('taken')\n"
    )

    def second() -> str:
        return subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True).stdout

    assert "another process writes" in second()
    first.close()
    assert "taken" in second()
