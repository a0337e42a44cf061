"""What the trial log teaches: successes, slips and collisions, read back by training's own reader."""

from pathlib import Path

import numpy as np
import pytest

from evg_app.errors import BadInput
from evg_app.events import (
    AttemptFinished,
    AttemptOutcome,
    AttemptStarted,
    Evidence,
    FrameTaken,
    Fused,
    GraspsPlanned,
    Judged,
    RoundStarted,
    RunStarted,
)
from evg_app.geometry import GRID_SIZE, MAX_OPENING, VOXEL_SIZE, make, rotation_about, translation
from evg_app.learning.from_trials import occupancy, shards_from_trials
from evg_app.learning.labels import Kind, WithContact
from evg_app.learning.shards import read_shard
from evg_app.trials.folder import make as make_folder
from evg_app.trials.labels import add_label
from evg_app.trials.store import TrialStore
from evg_app.types import Frame, Grasps, Intrinsics, TsdfGrid, Verdict

SMALL = {
    "reg": [1, 2, 2],
    "hidden": 2,
    "blocks": 1,
    "flow_reg": 1,
    "flow_triv": 4,
    "value_reg": 2,
    "contact_score": True,
}
POSITION_ATOL = 1e-6
"""float32 positions [m]."""
T_BASE_TASK = make(rotation_about("z", 0.3)[:3, :3], [0.4, -0.1, 0.02])
FAILURES = {0: "", 1: "nothing held after lift", 2: "contact on approach", 3: "device error"}


def grid() -> TsdfGrid:
    """A slab: free above, surface in the middle, the band behind it, unknown below."""
    values = np.zeros((GRID_SIZE,) * 3, np.float32)
    values[:, :, 20], values[:, :, 19], values[:, :, 18] = 0.8, 0.5, 0.2
    observed = np.zeros(values.shape, bool)
    observed[:, :, 18:] = True
    return TsdfGrid(values, observed)


@pytest.fixture
def run(tmp_path) -> Path:
    """One attempt of each end in rounds 0 to 3, and a success in round 9."""
    folder = make_folder(tmp_path / "run")
    store = TrialStore(folder, {}, {})
    store(RunStarted((0,), 10, "fake", ""))
    T = np.stack([translation(0.1, 0.15, 0.1), translation(0.2, 0.1, 0.05), translation(0.05, 0.05, 0.05)])
    frame = Frame(np.full((4, 4), 500, np.uint16), 0.001, Intrinsics(4, 4, 4, 4, 2, 2), 0.0, "cam")
    for index, failure in {**FAILURES, 9: ""}.items():
        store(RoundStarted(0, index, 1))
        store(AttemptStarted(f"a{index}", 0, index, 0, 1))
        store(FrameTaken(frame, np.zeros(7), np.eye(4), T_BASE_TASK))
        store(Fused(grid(), 100))
        store(GraspsPlanned(Grasps(T, np.full(3, 0.05), np.array([0.9, 0.8, 0.7]))))
        verdicts = (Verdict.GRIPPER_COLLISION, Verdict.ACCEPTED, Verdict.NOT_EXAMINED)
        store(Judged(verdicts, 1, False, T_BASE_TASK @ T[1]))
        outcome = AttemptOutcome.FAILURE if failure else AttemptOutcome.SUCCESS
        store(AttemptFinished(f"a{index}", outcome, not failure, None, failure, Evidence(width_lifted=0.031), 1.0, 1.0))
    store.close()
    return folder


def shards(out: Path):
    found = {path.stem.rsplit("_", 1)[1]: read_shard(path) for path in out.glob("shard_trials_*.npz")}
    return found["train"], found["validation"]


def test_each_end_of_an_attempt_becomes_its_kind(run, tmp_path):
    collected = shards_from_trials([run], tmp_path / "out")
    assert (collected.used, collected.positives, collected.left_out) == (4, 2, 1)
    (train, meta), (validation, _) = shards(tmp_path / "out")
    by_name = {scene.name: scene for scene in train}
    assert set(by_name) == {"trial/a0", "trial/a1", "trial/a2"} and not meta["validation"]
    assert [s.name for s in validation] == ["trial/a9"], "every tenth round is for validation, whole"
    kinds = {name: (Kind(s.kind[0]), WithContact(s.contact[0])) for name, s in by_name.items()}
    assert kinds == {
        "trial/a0": (Kind.POSITIVE, WithContact.HOLDS),
        "trial/a1": (Kind.SLIP, WithContact.FAILS),
        "trial/a2": (Kind.COLLISION, WithContact.UNKNOWN),
    }


def test_the_executed_grasp_comes_in_the_task_frame_with_the_measured_opening(run, tmp_path):
    shards_from_trials([run], tmp_path / "out")
    scene = shards(tmp_path / "out")[0][0][0]
    assert scene.position[0] == pytest.approx([0.2, 0.1, 0.05], abs=POSITION_ATOL)
    assert scene.rows[0] == pytest.approx([1, 0, 0, 0, 1, 0], abs=POSITION_ATOL)
    assert scene.width[0] == pytest.approx(0.031) and scene.width[1] == pytest.approx(MAX_OPENING)
    assert list(scene.kind[1:]) == [Kind.COLLISION], "the refused candidate is a collision"
    assert len(scene.positives) == 3, "the success and both proposals of unknown worth keep weak negatives away"
    assert scene.grids.shape == (8, GRID_SIZE, GRID_SIZE, GRID_SIZE)


def test_an_operator_s_word_goes_before_the_automatic_one(run, tmp_path):
    add_label(run, "a0", False)
    assert shards_from_trials([run], tmp_path / "out").positives == 1


def test_occupancy_is_sampled_where_a_ray_was():
    view = grid()
    points, occupied = occupancy(view.values, view.observed, np.random.default_rng(0))
    layer = np.floor(points[:, 2].astype(float) / VOXEL_SIZE + 1e-3).astype(int)
    assert layer.min() >= 18 and occupied.any() and not occupied.all()
    assert (layer[occupied] <= 19).all()


def test_a_folder_without_a_log_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match="no trial log"):
        shards_from_trials([tmp_path], tmp_path / "out")


def test_training_takes_the_shards_in(run, tmp_path):
    from evg_app.learning.dataset import SceneStore

    shards_from_trials([run], tmp_path / "out")
    store = SceneStore((tmp_path / "out",))
    assert store.refresh() == 2 and not store.corrupt


def test_a_failure_alone_teaches_and_what_it_lacks_is_not_made_up(run, tmp_path):
    import torch

    from evg_app.learning.batches import BatchSizes, draw
    from evg_app.learning.dataset import SceneStore
    from evg_app.learning.losses import losses_of
    from evg_app.nets.registry import build

    shards_from_trials([run], tmp_path / "out")
    store = SceneStore((tmp_path / "out",))
    store.refresh()
    assert store.train is not None and store.train.scenes == 3, "success, slip and contact"
    lost = [i for i in range(3) if not bool((store.train.kind[i] == int(Kind.POSITIVE)).any())]
    sizes = BatchSizes(8, 4, 4, 4, 8, 32)
    scene, still = torch.tensor(lost[:1]), torch.zeros((1, 3), dtype=torch.bool)
    batch = draw(store.train, sizes, scene, torch.zeros(1, dtype=torch.long), still, torch.Generator().manual_seed(0))
    assert len(lost) == 2 and not batch.positive_counts.any() and batch.judged_weight.any()
    losses = losses_of(build("equiigd", SMALL), batch, torch.Generator().manual_seed(0))
    assert losses["width"] == 0 and losses["flow"] == 0 and losses["score"] > 0 and torch.isfinite(losses["graspness"])
