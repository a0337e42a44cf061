"""Train a network on folders of shards within a time budget, on one CPU core or a GPU, resuming where it stopped."""

import csv
import json
import logging
import math
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from evg_app.errors import BadInput
from evg_app.grasping.planner import torch_device
from evg_app.grasping.weights import load_weights
from evg_app.learning.batches import BatchSizes, draw_batch
from evg_app.learning.curves import draw_curves
from evg_app.learning.dataset import SceneStore
from evg_app.learning.ema import WeightAverage
from evg_app.learning.losses import Network, losses_of
from evg_app.learning.metrics import evaluate
from evg_app.nets.equigiga import EquiGIGA
from evg_app.nets.equiigd import EquiIGD
from evg_app.nets.registry import build

log = logging.getLogger(__name__)

ALLOCATOR = {
    "MALLOC_MMAP_THRESHOLD_": "4294967296",
    "MALLOC_TRIM_THRESHOLD_": "17179869184",
    "OMP_NUM_THREADS": "1",
    "OMP_WAIT_POLICY": "passive",
}
"""Environment that halves the cost of a step; it must be set before python starts (learning.md §2)."""


@dataclass(frozen=True)
class TrainConfig:
    """How to train.

    Attributes:
        minutes: budget; the learning rate reaches its end when it is used up.
        max_steps: if given, the budget in steps instead (exactly repeatable).
        batch: scenes per step.
        sizes: queries per scene.
        learning_rate, final_rate: after the warm-up, and at the end.
        warmup_steps: linear warm-up.
        clip: largest norm of the gradient.
        ema: decay of the averaged weights.
        checkpoint_seconds, validate_seconds: how often.
        validation_scenes: how many scenes to measure on.
        seed: of weights and batches.
        architecture, network: name and config of the network (nets.registry).
        device: where torch trains, e.g. "cpu" or "cuda".
        start: weights file to start from instead of random weights.
    """

    minutes: float = 60.0
    max_steps: int | None = None
    batch: int = 6
    sizes: BatchSizes = field(default_factory=BatchSizes)
    learning_rate: float = 1e-3
    final_rate: float = 1e-5
    warmup_steps: int = 100
    clip: float = 5.0
    ema: float = 0.998
    checkpoint_seconds: float = 120.0
    validate_seconds: float = 300.0
    validation_scenes: int = 80
    seed: int = 0
    architecture: str = "equiigd"
    network: dict[str, Any] = field(default_factory=dict)
    device: str = "cpu"
    start: str | None = None


def restart_with_allocator() -> None:
    """Start this very command again with the environment of `ALLOCATOR`, unless it is set already."""
    if all(os.environ.get(k) == v for k, v in ALLOCATOR.items()):
        return
    os.environ.update(ALLOCATOR)
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


class Trainer:
    """The state of a training: network, average, optimiser, steps and time used. `folder` holds checkpoint and CSV."""

    def __init__(self, config: TrainConfig, store: SceneStore, folder: Path) -> None:
        torch.set_num_threads(1)
        torch.set_float32_matmul_precision("high")
        torch.manual_seed(config.seed)
        model = _network(config)
        self.started_from = ""
        if config.start is not None:
            start, card = load_weights(config.start)
            model.load_state_dict(start.state_dict())
            self.started_from = card.sha256
        self.config, self.store, self.folder, self.model = config, store, folder, model.to(torch_device(config.device))
        self.average = WeightAverage(self.model, config.ema)
        self.optimiser = torch.optim.Adam(
            self.model.parameters(), lr=config.learning_rate, fused=torch.device(config.device).type == "cuda"
        )
        self.step, self.used_seconds, self.scene_visits = 0, 0.0, 0
        self.metrics: dict[str, float] = {}
        self._recent: dict[str, Tensor] = {}

    @property
    def progress(self) -> float:
        """Share of the budget that is used, from 0 to 1."""
        if self.config.max_steps is not None:
            return self.step / self.config.max_steps
        return self.used_seconds / (60.0 * self.config.minutes)

    def rate(self) -> float:
        """Learning rate now: linear warm-up, then a cosine over the budget."""
        c = self.config
        cosine = 0.5 * (1.0 + math.cos(math.pi * min(self.progress, 1.0)))
        return (c.final_rate + (c.learning_rate - c.final_rate) * cosine) * min(1.0, (self.step + 1) / c.warmup_steps)

    def train_step(self) -> None:
        """One batch forward and back."""
        started = time.monotonic()
        for group in self.optimiser.param_groups:
            group["lr"] = self.rate()
        assert self.store.train is not None
        generator = torch.Generator(self.store.device).manual_seed(self.config.seed * 1_000_003 + self.step)
        batch = draw_batch(self.store.train, self.config.sizes, self.config.batch, generator)
        losses = losses_of(self.model, batch, generator)
        total = torch.stack(list(losses.values())).sum()
        self.optimiser.zero_grad(set_to_none=True)
        total.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(self.model.parameters(), self.config.clip)
        if torch.isfinite(norm):
            self.optimiser.step()
            self.average.update(self.model)
        else:
            log.warning("step %d: gradient is not finite, left out", self.step)
        self.step += 1
        self.scene_visits += self.config.batch
        self.used_seconds += time.monotonic() - started
        self._note({k: v.detach() for k, v in losses.items()})

    def validate(self) -> dict[str, float]:
        """Measure the averaged weights and append a row to metrics.csv."""
        averaged = _network(self.config).to(torch_device(self.config.device))
        averaged.load_state_dict(self.average.state)
        scenes = self.store.validation
        self.metrics = evaluate(averaged, scenes, self.config.validation_scenes) if scenes is not None else {}
        row = {
            "step": self.step,
            "minutes": self.used_seconds / 60.0,
            "scene_visits": self.scene_visits,
            "train_scenes": 0 if self.store.train is None else self.store.train.scenes,
            "rate": self.rate(),
            **{f"loss_{k}": float(v) for k, v in self._recent.items()},
            **self.metrics,
        }
        table = self.folder / "metrics.csv"
        _append_row(table, row)
        draw_curves(table)
        log.info("%s", "  ".join(f"{k} {v:.4g}" for k, v in row.items()))
        return self.metrics

    def save(self) -> Path:
        """Write the checkpoint atomically; returns its path."""
        path = checkpoint_path(self.folder)
        state = {
            "config": json.dumps(asdict(self.config)),
            "model": self.model.state_dict(),
            "average": self.average.state,
            "average_count": self.average.count,
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "used_seconds": self.used_seconds,
            "scene_visits": self.scene_visits,
            "started_from": self.started_from,
            "metrics": self.metrics,
            "data": json.dumps(self.store.describe()),
        }
        temporary = path.with_suffix(".part")
        torch.save(state, temporary)
        temporary.replace(path)
        return path

    def load(self) -> bool:
        """Go on from the folder's checkpoint; False if there is none.

        Raises:
            BadInput: it belongs to another network or seed.
        """
        path = checkpoint_path(self.folder)
        if not path.exists():
            return False
        state = torch.load(path, weights_only=True, map_location=torch_device(self.config.device))
        other = json.loads(state["config"])
        mine = json.loads(json.dumps(asdict(self.config)))
        for key in ("architecture", "network", "seed", "batch", "sizes"):
            if other[key] != mine[key]:
                raise BadInput(f"{path} was trained with {key}={other[key]}, not {mine[key]}; use another --out")
        self.model.load_state_dict(state["model"])
        self.average.state, self.average.count = state["average"], state["average_count"]
        self.optimiser.load_state_dict(state["optimiser"])
        self.step, self.used_seconds = state["step"], state["used_seconds"]
        self.scene_visits, self.metrics = state["scene_visits"], state["metrics"]
        self.started_from = state["started_from"]
        return True

    def _note(self, losses: dict[str, Tensor]) -> None:
        """Running means of the losses."""
        for key, value in losses.items():
            self._recent[key] = 0.98 * self._recent.get(key, value) + 0.02 * value


def checkpoint_path(folder: Path) -> Path:
    """The checkpoint of a training folder."""
    return folder / "checkpoint.pt"


def _network(config: TrainConfig) -> Network:
    """The network to train, with random weights.

    Raises:
        BadInput: it cannot be trained.
    """
    model = build(config.architecture, config.network)
    if not isinstance(model, EquiIGD | EquiGIGA):
        raise BadInput(f"training of '{config.architecture}' is not available; use equiigd or equigiga")
    return model


def train(config: TrainConfig, data: Sequence[Path], folder: Path, stop: Callable[[], bool] = lambda: False) -> Path:
    """Train until the budget is used up, taking in new shards on the way; returns the checkpoint's path.

    When `stop()` says so, it ends after the step under way: everything is in the checkpoint, nothing is measured.

    Raises:
        BadInput: no data, or the folder's checkpoint belongs to another training.
    """
    folder.mkdir(parents=True, exist_ok=True)
    store = SceneStore(data, config.device)
    store.refresh()
    if store.train is None:
        raise BadInput(f"{data[0]} holds no training scenes yet; run evg-app generate --out {data[0]} first")
    trainer = Trainer(config, store, folder)
    resumed = trainer.load()
    log.info("%s at step %d, data: %s", "resumed" if resumed else "started", trainer.step, store.describe())
    saved = validated = time.monotonic()
    while trainer.progress < 1.0 and not stop():
        trainer.train_step()
        now = time.monotonic()
        if trainer.step % 50 == 0:
            log.info(
                "step %d  %.1f min  %d scenes visited", trainer.step, trainer.used_seconds / 60, trainer.scene_visits
            )
        if now - saved > config.checkpoint_seconds:
            trainer.save()
            store.refresh()
            saved = time.monotonic()
        if now - validated > config.validate_seconds:
            trainer.validate()
            validated = time.monotonic()
    if not stop():
        trainer.validate()
    return trainer.save()


def _append_row(path: Path, row: dict[str, float]) -> None:
    """Append a row to a CSV, with a header if it is new; a row with other columns than the header's keeps those."""
    new = not path.exists()
    columns = list(row) if new else path.read_text(encoding="utf-8").splitlines()[0].split(",")
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=columns, restval="nan", extrasaction="ignore")
        if new:
            writer.writeheader()
        writer.writerow({k: round(v, 6) for k, v in row.items()})
