"""Shards: written whole, read back, and never silently wrong."""

import itertools
import os
from pathlib import Path

import numpy as np
import pytest
import torch

from evg_app.errors import BadInput
from evg_app.learning.batches import Batch, BatchSizes, draw, draw_batch
from evg_app.learning.dataset import SceneStore
from evg_app.learning.labels import Kind, WithContact
from evg_app.learning.pools import is_validation, object_pools
from evg_app.learning.shards import CorruptShard, SceneSample, quantise, read_shard, write_shard
from evg_app.learning.tables import GRASPS, NO_KIND, SceneTable, table_of

ROUNDING = 0.5 / 255.0 + 1e-7
SIZES = BatchSizes(positives=8, collisions=4, slips=8, proposals=4, weak=8, occupancy=16)


def scene(seed: int = 0, grasps: int = 20) -> SceneSample:
    """A made-up scene with plausible arrays: half of the grasps positive."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(grasps, 3, 3)))
    q *= np.sign(np.linalg.det(q))[:, None, None]
    kind = np.where(np.arange(grasps) % 2 == 0, Kind.POSITIVE, Kind.SLIP).astype(np.uint8)
    position = rng.uniform(0.05, 0.25, (grasps, 3)).astype(np.float32)
    return SceneSample(
        grids=rng.integers(0, 255, (2, 40, 40, 40), dtype=np.uint8),
        views=("side/gamma", "igd/gaussian"),
        rows=q[:, :2].reshape(-1, 6).astype(np.float32),
        position=position,
        width=np.full(grasps, 0.03, dtype=np.float32),
        kind=kind,
        contact=np.where(kind == Kind.POSITIVE, WithContact.HOLDS, WithContact.UNKNOWN).astype(np.uint8),
        proposed=np.zeros(grasps, dtype=np.bool_),
        positives=position[kind == Kind.POSITIVE].astype(np.float16),
        points=rng.random((64, 3)).astype(np.float16) * np.float16(0.3),
        occupied=rng.random(64) < 0.2,
        name=f"pile/{seed}",
        objects=("mug_1", f"box_{seed}"),
        placement=(("objects/train/mug_1", 0.9, tuple(range(12))),),
        verified=((2, 1, 1, 0),),
    )


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def drawn(table: SceneTable, mirror: tuple[bool, bool, bool] = (False, False, False)) -> Batch:
    """The first scene of a table seen through its first view."""
    first = torch.tensor([0])
    return draw(table, SIZES, first, first, torch.tensor([mirror]), generator(5))


def test_shard_round_trip(tmp_path: Path) -> None:
    scenes = [scene(0, 20), scene(1, 12)]
    write_shard(tmp_path / "shard_00001.npz", scenes, {"validation": False})
    back, meta = read_shard(tmp_path / "shard_00001.npz")
    assert meta["validation"] is False and [p.name for p in tmp_path.iterdir()] == ["shard_00001.npz"]
    for before, after in zip(scenes, back, strict=True):
        assert after.views == before.views and after.objects == before.objects and after.name == before.name
        assert after.placement == before.placement and after.verified == before.verified
        for key in (
            "grids",
            "rows",
            "position",
            "width",
            "kind",
            "contact",
            "proposed",
            "positives",
            "points",
            "occupied",
        ):
            assert (getattr(after, key) == getattr(before, key)).all(), key


def test_truncated_shard_is_named_counted_and_skipped(tmp_path: Path) -> None:
    for k in (1, 2):
        write_shard(tmp_path / f"shard_0000{k}.npz", [scene(k)], {"validation": False})
    broken = tmp_path / "shard_00002.npz"
    broken.write_bytes(broken.read_bytes()[:2000])
    with pytest.raises(CorruptShard, match=r"shard_00002\.npz"):
        read_shard(broken)
    store = SceneStore([tmp_path])
    assert store.refresh() == 1
    assert store.corrupt == ["shard_00002.npz"] and store.train is not None and store.train.scenes == 1
    assert store.describe()["corrupt_shards"] == 1


def test_store_takes_in_shards_as_they_appear(tmp_path: Path) -> None:
    store = SceneStore([tmp_path])
    write_shard(tmp_path / "shard_00000.npz", [scene(0)], {"validation": True})
    assert store.refresh() == 1 and store.train is None
    assert store.validation is not None and store.validation.scenes == 1
    write_shard(tmp_path / "shard_00001.npz", [scene(1)], {"validation": False})
    assert store.refresh() == 1 and store.refresh() == 0
    assert store.train is not None and store.train.scenes == 1


def test_shard_that_is_written_again_is_not_taken_in_twice(tmp_path: Path) -> None:
    store, path = SceneStore([tmp_path]), tmp_path / "shard_00001.npz"
    write_shard(path, [scene(1)], {"validation": False})
    store.refresh()
    write_shard(path, [scene(1)], {"validation": False})
    os.utime(path, (1, 1))
    assert store.refresh() == 0
    assert store.train is not None and store.train.scenes == 1


def test_missing_data_folder_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="evg-app generate"):
        SceneStore([tmp_path / "nothing"]).refresh()


def test_quantisation_keeps_zero_and_is_fine_enough() -> None:
    values = np.linspace(0, 1, 1001, dtype=np.float32)
    assert np.abs(quantise(values) / 255.0 - values).max() <= ROUNDING
    assert quantise(np.zeros(1, dtype=np.float32))[0] == 0


def test_batch_is_a_function_of_seed_and_step() -> None:
    scenes = table_of([scene(k) for k in range(4)])
    a, b = draw_batch(scenes, SIZES, 3, generator(7)), draw_batch(scenes, SIZES, 3, generator(7))
    other = draw_batch(scenes, SIZES, 3, generator(8))
    assert all((vars(a)[k] == vars(b)[k]).all() for k in vars(a))
    assert not (a.positive == other.positive).all()
    assert a.grid.shape == (3, 1, 40, 40, 40) and a.positive_rotation.shape == (3, 8, 3, 3)


def seen_at(batch: Batch, points: torch.Tensor) -> torch.Tensor:
    """The grid's values at points (1, N, 3)."""
    x, y, z = ((points[0] + 0.5) * 40).long().clamp(0, 39).unbind(-1)
    return batch.grid[0, 0][x, y, z]


@pytest.mark.parametrize("mirror", list(itertools.product([False, True], repeat=3)))
def test_turning_and_mirroring_move_grid_points_and_rotations_together(mirror: tuple[bool, bool, bool]) -> None:
    table = table_of([scene(3)])
    plain, moved = drawn(table), drawn(table, mirror)
    assert (moved.grid == plain.grid).all() == (mirror == (False, False, False))
    for name in ("positive", "judged", "point"):
        assert torch.equal(seen_at(moved, getattr(moved, name)), seen_at(plain, getattr(plain, name)))
    M = moved.positive_rotation[0]
    assert torch.allclose(torch.linalg.det(M), torch.ones(8), atol=1e-5)
    for column, ahead in ((2, 1.0), (1, -1.0 if sum(mirror) % 2 else 1.0)):
        tip = plain.positive + 0.1 * plain.positive_rotation[..., column]
        expected = tip * torch.tensor([-1.0 if mirror[0] else 1.0, -1.0 if mirror[1] else 1.0, 1.0])
        expected = expected[..., [1, 0, 2]] if mirror[2] else expected
        assert torch.allclose(moved.positive + ahead * 0.1 * moved.positive_rotation[..., column], expected, atol=1e-6)


def test_batch_draws_grasps_of_the_scene_without_repetition_where_there_are_enough() -> None:
    one, batch = scene(6), drawn(table_of([scene(6)]))
    good = one.position[one.kind == Kind.POSITIVE]
    found = (batch.positive[0].numpy() + 0.5) * 0.3
    nearest = np.linalg.norm(found[:, None] - good[None], axis=2)
    assert nearest.min(axis=1).max() < 1e-6 and len(set(nearest.argmin(axis=1).tolist())) == SIZES.positives


def test_groups_that_a_scene_lacks_have_no_weight() -> None:
    batch = drawn(table_of([scene(6)]))
    weight = batch.judged_weight[0]
    assert not weight[:4].any() and not weight[-4:].any()
    assert (weight[4:12] == torch.tensor([1.0, 0.0])).all()


def test_table_pads_what_is_short_and_keeps_what_is_there() -> None:
    table = table_of([scene(0, 20), scene(1, 12)])
    assert table.kind.shape == (2, GRASPS) and (table.kind[1, 12:] == NO_KIND).all()
    assert np.array_equal(table.rows[1, :12].numpy(), scene(1, 12).rows)
    assert table.join(table).scenes == 4


def test_negatives_near_a_positive_do_not_count_for_graspness() -> None:
    one = scene(4)
    near = one.position.copy()
    near[1::2] = near[0::2] + np.float32(0.004)
    crowded = SceneSample(**(vars(one) | {"position": near, "positives": near[0::2].astype(np.float16)}))
    batch = drawn(table_of([crowded]))
    assert not batch.judged_counts.any()
    weak = (batch.weak[0].numpy() + 0.5) * 0.3
    distance = np.linalg.norm(weak[:, None] - near[None, 0::2], axis=2).min(axis=1)
    assert (distance[batch.weak_counts[0].numpy() > 0] > 0.02 - 1e-3).all()


def test_no_object_is_in_both_splits() -> None:
    train, validation = object_pools((), (), False), object_pools((), (), True)
    names = [{o.name for pools in side.values() for objects in pools for o in objects} for side in (train, validation)]
    assert names[0] and names[1] and not names[0] & names[1]
    assert all(is_validation(n) for n in names[1]) and not any(is_validation(n) for n in names[0])


def test_held_out_names_are_the_committed_ones() -> None:
    listed = Path(__file__).parents[2] / "docs" / "benchmark" / "validation_names.txt"
    names = [line for line in listed.read_text().splitlines() if line and not line.startswith("#")]
    assert len(names) >= 65 and all(is_validation(name) for name in names)
    assert sum(is_validation(f"{name}x") for name in names) < len(names) / 2
