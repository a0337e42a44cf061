"""Generated scenes: a pure function of config and unit, resumable, and true in physics."""

import logging
from pathlib import Path

import numpy as np
import pytest

from evg_app.errors import BadInput
from evg_app.geometry import invert, make
from evg_app.learning import generate as generating
from evg_app.learning.generate import GenerateConfig, generate, make_scene, shard_name, solids_of
from evg_app.learning.labels import Kind, balance, sample_and_label
from evg_app.learning.physics import TrialBench
from evg_app.learning.shards import read_shard
from evg_app.learning.solids import SceneSolids
from evg_app.learning.surface import half_spaces, sample_surface
from evg_app.learning.views import noisy_grid
from evg_app.perception.tsdf import fuse_depth
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.rendering import SceneCaster
from evg_app.simulation.scenes import SceneRecipe, generate_scene_state
from evg_app.simulation.views import D435I, side_view

PRECISION = 0.9
"""Least share of positives that must hold in physics (packed scenes)."""
SLIPS_HELD, COLLISIONS_HELD = 0.35, 0.05
"""Largest share of the two kinds of negatives that may hold all the same."""
GRID_TOLERANCE = 0.009
"""1 mm depth steps against exact depth, in grid values (60 mm each), at any voxel of the band."""

CONFIG = GenerateConfig(seed=3, scenes=2, candidates=600, grasps=30, points=512, mean_objects=1.0, verified=0.05)


@pytest.fixture(autouse=True)
def small_shards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generating, "SHARD_SIZE", 1)


def test_scene_is_a_pure_function_of_config_and_unit() -> None:
    a, b, other = make_scene(CONFIG, 5, False), make_scene(CONFIG, 5, False), make_scene(CONFIG, 6, False)
    for key in ("grids", "rows", "position", "width", "kind", "contact", "positives", "points", "occupied"):
        assert np.array_equal(getattr(a, key), getattr(b, key)), key
    assert a.placement == b.placement != other.placement
    assert not np.array_equal(a.grids, other.grids)


def test_generate_resumes_and_replaces_a_corrupt_shard(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    seen: list[tuple[str, int, int]] = []
    assert generate(CONFIG, tmp_path, 1, lambda report, done, of: seen.append((report.name, done, of))) == 2
    assert seen == [(shard_name(0), 1, 2), (shard_name(1), 2, 2)]
    assert generate(CONFIG, tmp_path) == 0
    second = tmp_path / shard_name(1)
    whole = second.read_bytes()
    second.write_bytes(whole[:1000])
    with caplog.at_level(logging.WARNING):
        assert generate(CONFIG, tmp_path) == 1
    assert shard_name(1) in caplog.text
    assert read_shard(second)[0][0].name.endswith("/1")


def test_a_share_of_the_labels_is_tried_in_physics_and_counted(tmp_path: Path) -> None:
    generate(CONFIG, tmp_path)
    scenes, meta = read_shard(tmp_path / shard_name(0))
    tried = sum(n for name, (_, n) in meta["agreement"].items() if not name.endswith("contact"))
    assert tried == len(scenes[0].verified) == round(CONFIG.verified * len(scenes[0].kind))


def test_folder_of_another_config_is_refused(tmp_path: Path) -> None:
    generate(GenerateConfig(seed=3, scenes=1, candidates=300, grasps=5, points=64, mean_objects=0.5), tmp_path)
    with pytest.raises(BadInput, match="other settings"):
        generate(GenerateConfig(seed=4, scenes=1), tmp_path)


def test_missing_objects_folder_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="nowhere"):
        generate(GenerateConfig(pile_folders=(str(tmp_path / "nowhere"),)), tmp_path)


def test_casting_only_needed_pixels_gives_the_grid_of_the_whole_image() -> None:
    state = generate_scene_state(SceneRecipe("packed", 2), builtin_objects("train"), seed=1)
    caster, T_task_cam = SceneCaster(state), side_view()
    whole = fuse_depth(caster.depth(D435I, T_task_cam), D435I, invert(T_task_cam)).values
    fast = noisy_grid(caster, T_task_cam, "none", np.random.default_rng(0))
    both = (whole > 0) & (fast > 0)
    assert both.sum() > 0.98 * (whole > 0).sum()
    assert np.abs(whole - fast)[both].max() < GRID_TOLERANCE


@pytest.mark.slow
def test_labels_agree_with_physics() -> None:
    tally: dict[int, list[bool]] = {kind: [] for kind in Kind}
    for seed in range(4):
        objects = builtin_objects("train")
        state = generate_scene_state(SceneRecipe("packed", 3), objects, seed)
        solids, rng = solids_of(state), np.random.default_rng(seed)
        points = sample_surface(solids, half_spaces(solids), 1500, rng)
        grasps = balance(sample_and_label(SceneSolids(solids), points, 1500, rng), 10, 0.5, rng)
        bench = TrialBench(state)
        for T, kind in zip(grasps.T_task_grasp, grasps.kind, strict=True):
            tally[int(kind)].append(bench(T).kind == Kind.POSITIVE)
        bench.close()
    assert np.mean(tally[Kind.POSITIVE]) >= PRECISION
    assert np.mean(tally[Kind.SLIP]) <= SLIPS_HELD
    assert np.mean(tally[Kind.COLLISION]) <= COLLISIONS_HELD


def test_trial_in_the_air_holds_nothing_and_touches_nothing() -> None:
    state = generate_scene_state(SceneRecipe("packed", 1), builtin_objects("train"), seed=2)
    bench = TrialBench(state)
    trial = bench(make(np.diag([1.0, -1.0, -1.0]), [0.02, 0.02, 0.29]))
    bench.close()
    assert not trial.touched and not trial.held
