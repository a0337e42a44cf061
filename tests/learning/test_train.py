"""Training: losses that reward the truth, exact resuming, honest metrics, loadable exports."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from evg_app.cli.main import main
from evg_app.errors import BadInput
from evg_app.grasping.weights import load_weights
from evg_app.learning.batches import Batch, BatchSizes, draw_batch
from evg_app.learning.dataset import SceneStore
from evg_app.learning.ema import WeightAverage
from evg_app.learning.export import export_weights
from evg_app.learning.labels import Kind, WithContact
from evg_app.learning.losses import focal, losses_of, rotation_distance
from evg_app.learning.metrics import average_precision, evaluate
from evg_app.learning.shards import SceneSample, write_shard
from evg_app.learning.tables import SceneTable, table_of
from evg_app.learning.train import ALLOCATOR, TrainConfig, Trainer, checkpoint_path, restart_with_allocator, train
from evg_app.nets.registry import build

EXACT = 1e-6
ANGLE = 0.3

SMALL: dict[str, Any] = {"reg": [1, 2, 2], "hidden": 2, "blocks": 1, "flow_reg": 1, "flow_triv": 4, "value_reg": 2}
SMALL["contact_score"] = True
SIZES = BatchSizes(positives=4, collisions=3, slips=2, proposals=2, weak=4, occupancy=16)
CONFIG = TrainConfig(max_steps=6, batch=2, sizes=SIZES, warmup_steps=2, validation_scenes=1, network=SMALL)


def scene(seed: int) -> SceneSample:
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(12, 3, 3)))
    q *= np.sign(np.linalg.det(q))[:, None, None]
    kind = np.where(np.arange(12) % 2 == 0, Kind.POSITIVE, Kind.COLLISION).astype(np.uint8)
    kind[9:] = Kind.SLIP
    position = rng.uniform(0.05, 0.25, (12, 3)).astype(np.float32)
    return SceneSample(
        grids=rng.integers(0, 255, (1, 40, 40, 40), dtype=np.uint8),
        views=("side/gamma",),
        rows=q[:, :2].reshape(-1, 6).astype(np.float32),
        position=position,
        width=np.full(12, 0.03, dtype=np.float32),
        kind=kind,
        contact=np.where(kind == Kind.POSITIVE, WithContact.HOLDS, WithContact.FAILS).astype(np.uint8),
        proposed=np.arange(12) == 11,
        positives=position[kind == Kind.POSITIVE].astype(np.float16),
        points=(rng.random((1200, 3)) * 0.3).astype(np.float16),
        occupied=rng.random(1200) < 0.2,
        name=f"pile/{seed}",
        objects=("mug_1",),
    )


def table(*seeds: int) -> SceneTable:
    return table_of([scene(seed) for seed in seeds])


@pytest.fixture
def data(tmp_path: Path) -> Path:
    folder = tmp_path / "data"
    write_shard(folder / "shard_00000.npz", [scene(0)], {"validation": True})
    write_shard(folder / "shard_00001.npz", [scene(k) for k in range(1, 4)], {"validation": False})
    return folder


def trainer(data: Path, folder: Path, config: TrainConfig = CONFIG) -> Trainer:
    folder.mkdir(exist_ok=True)
    store = SceneStore([data])
    store.refresh()
    return Trainer(config, store, folder)


def test_resumed_training_equals_an_uninterrupted_one(data: Path, tmp_path: Path) -> None:
    whole = trainer(data, tmp_path / "whole")
    for _ in range(4):
        whole.train_step()
    first = trainer(data, tmp_path / "parts")
    for _ in range(2):
        first.train_step()
    first.save()
    second = trainer(data, tmp_path / "parts")
    assert second.load() and second.step == 2
    for _ in range(2):
        second.train_step()
    for key, value in whole.model.state_dict().items():
        assert torch.equal(value, second.model.state_dict()[key]), key
        assert torch.equal(whole.average.state[key], second.average.state[key]), key
    assert second.scene_visits == whole.scene_visits


def test_train_export_and_load_give_the_averaged_network(data: Path, tmp_path: Path) -> None:
    checkpoint = train(CONFIG, [data], tmp_path / "out")
    rows = (tmp_path / "out" / "metrics.csv").read_text().splitlines()
    assert len(rows) == 2 and "graspness_ap" in rows[0]
    card_path = export_weights(checkpoint, tmp_path / "small.safetensors", {"benchmark": None})
    model, card = load_weights(tmp_path / "small.safetensors")
    assert card.architecture == "equiigd" and card.training["steps"] == 6
    assert card.training["data"]["train_scenes"] == 3
    assert json.loads(card_path.read_text())["parameters"] == sum(p.numel() for p in model.parameters())
    average = torch.load(checkpoint, weights_only=True)["average"]
    assert all(torch.equal(v, average[k]) for k, v in model.state_dict().items())


def test_training_draws_its_course(data: Path, tmp_path: Path) -> None:
    train(CONFIG, [data], tmp_path / "out")
    assert (tmp_path / "out" / "metrics.png").read_bytes()[:4] == b"\x89PNG"


def test_other_seed_does_not_continue_a_checkpoint(data: Path, tmp_path: Path) -> None:
    one = trainer(data, tmp_path / "out")
    one.save()
    other = trainer(data, tmp_path / "out", TrainConfig(**(vars(CONFIG) | {"seed": 9})))
    with pytest.raises(BadInput, match="seed"):
        other.load()


def test_no_data_yet_says_what_to_run(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="evg-app generate"):
        train(CONFIG, [tmp_path], tmp_path / "out")


def test_export_refuses_what_is_not_a_checkpoint(tmp_path: Path) -> None:
    (tmp_path / "bad.pt").write_bytes(b"nothing")
    with pytest.raises(BadInput, match=r"bad\.pt"):
        export_weights(tmp_path / "bad.pt", tmp_path / "w.safetensors")
    with pytest.raises(BadInput, match="safetensors"):
        export_weights(tmp_path / "bad.pt", tmp_path / "w.pt")


def test_learning_rate_warms_up_and_ends_low(data: Path, tmp_path: Path) -> None:
    one = trainer(data, tmp_path / "out", TrainConfig(**(vars(CONFIG) | {"max_steps": 100, "warmup_steps": 10})))
    rates = []
    for step in range(101):
        one.step = step
        rates.append(one.rate())
    assert rates[0] < 0.15e-3 and max(rates) > 0.9e-3 and np.argmax(rates) == 9
    assert rates[-1] == pytest.approx(CONFIG.final_rate) and (np.diff(rates[9:]) < 0).all()


def test_a_few_steps_on_one_scene_lower_the_loss() -> None:
    torch.manual_seed(0)
    model = build("equiigd", SMALL)
    batch = draw_batch(table(1), SIZES, 1, torch.Generator().manual_seed(0))
    optimiser = torch.optim.Adam(model.parameters(), lr=1e-2)
    totals = []
    for _ in range(30):
        total = torch.stack(list(losses_of(model, batch, torch.Generator().manual_seed(0)).values())).sum()
        optimiser.zero_grad()
        total.backward()
        optimiser.step()
        totals.append(float(total.detach()))
    assert totals[-1] < 0.85 * totals[0]


def test_negatives_that_do_not_count_leave_graspness_alone() -> None:
    torch.manual_seed(0)
    model = build("equiigd", SMALL)
    batch = draw_batch(table(1), SIZES, 1, torch.Generator().manual_seed(0))
    nothing = torch.zeros_like(batch.judged_counts)
    moved = Batch(**(vars(batch) | {"judged_counts": nothing, "judged": batch.judged + 0.1}))
    still = Batch(**(vars(batch) | {"judged_counts": nothing}))
    losses = [losses_of(model, b, torch.Generator().manual_seed(0))["graspness"].item() for b in (still, moved)]
    assert losses[0] == pytest.approx(losses[1], abs=EXACT)


def test_rotation_distance_ignores_which_finger_is_which() -> None:
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    a = torch.eye(3)
    b = torch.tensor([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=torch.float32)
    flipped = b * torch.tensor([-1.0, -1.0, 1.0])
    expected = np.sin(ANGLE / 2) ** 2
    assert float(rotation_distance(a, b)) == pytest.approx(expected, abs=EXACT)
    assert float(rotation_distance(a, flipped)) == pytest.approx(expected, abs=EXACT)


def test_focal_loss_by_hand() -> None:
    logit, label = torch.tensor([np.log(3.0), np.log(3.0)]), torch.tensor([1.0, 0.0])
    each = [0.25**2 * -np.log(0.75), 0.75**2 * -np.log(0.25)]
    assert float(focal(logit, label, torch.ones(2))) == pytest.approx(np.mean(each), abs=EXACT)
    assert float(focal(logit, label, torch.tensor([0.0, 1.0]))) == pytest.approx(each[1], abs=EXACT)


def test_average_precision_by_hand() -> None:
    assert average_precision([3, 2, 1, 0], [1, 1, 0, 0]) == pytest.approx(1.0)
    assert average_precision([3, 2, 1, 0], [0, 1, 0, 1]) == pytest.approx(0.5 * 0.5 + 0.5 * 0.5)
    assert average_precision([1, 1, 1, 1], [1, 0, 0, 0]) == pytest.approx(0.25)


def test_metrics_are_repeatable_and_leave_the_network_alone() -> None:
    torch.manual_seed(0)
    model = build("equiigd", SMALL).train()
    scenes = table(1, 2)
    first = evaluate(model, scenes)
    assert first == evaluate(model, scenes) and model.training
    assert 0 <= first["graspness_ap"] <= 1 and 0 < first["flow_deg"] <= 180


def test_average_follows_fast_then_slowly() -> None:
    layer = torch.nn.Linear(1, 1, bias=False)
    layer.weight.data.fill_(0.0)
    average = WeightAverage(layer, 0.9)
    layer.weight.data.fill_(1.0)
    average.update(layer)
    assert float(average.state["weight"]) == pytest.approx(1 - 2 / 11, abs=EXACT)


def test_command_restarts_itself_once_with_the_allocator_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[str, list[str]]] = []
    monkeypatch.setattr("os.execv", lambda path, argv: calls.append((path, argv)))
    for key in ALLOCATOR:
        monkeypatch.delenv(key, raising=False)
        monkeypatch.setenv(key, "")
    restart_with_allocator()
    restart_with_allocator()
    assert len(calls) == 1 and calls[0][1][0] == calls[0][0]


def test_checkpoint_is_replaced_whole(data: Path, tmp_path: Path) -> None:
    one = trainer(data, tmp_path / "out")
    one.save()
    one.train_step()
    one.save()
    assert [p.name for p in (tmp_path / "out").iterdir()] == [checkpoint_path(tmp_path / "out").name]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_training_ended_by_a_signal_has_saved_every_step(number, data: Path, tmp_path: Path, monkeypatch, capsys):
    step = Trainer.train_step

    def interrupted(self: Trainer) -> None:
        if self.step == 1:
            os.kill(os.getpid(), number)
        step(self)

    monkeypatch.setattr(Trainer, "train_step", interrupted)
    monkeypatch.setattr("evg_app.learning.train.restart_with_allocator", lambda: None)
    folder = tmp_path / "out"
    assert main(["train", "--data", str(data), "--out", str(folder), "--model", "equigiga", "--batch", "1"]) == 130
    assert "the same command goes on" in capsys.readouterr().err
    assert torch.load(checkpoint_path(folder), weights_only=True)["step"] == 2
    assert not (folder / "metrics.csv").exists()
