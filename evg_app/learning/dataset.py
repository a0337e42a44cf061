"""The scenes of folders of shards, in memory; new shards are taken in as they appear."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path

import numpy as np
import torch

from evg_app.errors import BadInput
from evg_app.learning.labels import Kind
from evg_app.learning.shards import FROM_TRIAL, CorruptShard, SceneSample, read_shard
from evg_app.learning.tables import SceneTable, table_of

log = logging.getLogger(__name__)


@dataclass
class SceneStore:
    """Scenes by shard, in the order of the shards' names.

    Attributes:
        folders: where the shards are.
        device: where the scenes are kept.
        train, validation: scenes to learn from and to measure on; None while there are none.
        corrupt: shards that could not be read, by name; each is read again when it changes.
    """

    folders: Sequence[Path]
    device: str = "cpu"
    train: SceneTable | None = None
    validation: SceneTable | None = None
    corrupt: list[str] = field(default_factory=list)
    _read: set[str] = field(default_factory=set)
    _seen: dict[str, float] = field(default_factory=dict)
    _names: dict[bool, set[str]] = field(default_factory=lambda: {True: set(), False: set()})
    _agreement: dict[str, list[int]] = field(default_factory=dict)

    def refresh(self) -> int:
        """Read shards that are new since the last call. Returns how many were taken in.

        Raises:
            BadInput: a folder does not exist.
        """
        taken: dict[bool, list[SceneTable]] = {True: [], False: []}
        for folder in self.folders:
            if not folder.is_dir():
                raise BadInput(f"data folder {folder} does not exist; run evg-app generate --out {folder} first")
            for path in sorted(folder.glob("shard_*.npz")):
                stamp = path.stat().st_mtime
                if str(path) not in self._read and self._seen.get(str(path)) != stamp:
                    self._seen[str(path)] = stamp
                    self._take(path, taken)
        self.train = _joined(self.train, taken[False])
        self.validation = _joined(self.validation, taken[True])
        return len(taken[True]) + len(taken[False])

    def _take(self, path: Path, taken: dict[bool, list[SceneTable]]) -> None:
        """Read one shard, unless it is corrupt."""
        try:
            scenes, meta = read_shard(path)
        except CorruptShard as error:
            self.corrupt.append(path.name)
            log.warning("skipped (%d so far): %s", len(self.corrupt), error)
            return
        self._read.add(str(path))
        usable = [s for s in scenes if is_usable(s, bool(meta["validation"]))]
        if usable:
            taken[bool(meta["validation"])].append(table_of(usable, self.device))
        self._names[bool(meta["validation"])].update(name for s in usable for name in s.objects)
        for name, counts in meta.get("agreement", {}).items():
            total = self._agreement.setdefault(name, [0, 0])
            total[0], total[1] = total[0] + counts[0], total[1] + counts[1]

    def describe(self) -> dict[str, object]:
        """Counts for logs and cards."""
        kind, proposed = (
            (self.train.kind.cpu().numpy(), self.train.proposed.cpu().numpy())
            if self.train is not None
            else (np.zeros(0), np.zeros(0, dtype=bool))
        )
        return {
            "train_scenes": 0 if self.train is None else self.train.scenes,
            "views": 0 if self.train is None else self.train.views,
            "validation_scenes": 0 if self.validation is None else self.validation.scenes,
            "train_positives": int(((kind == Kind.POSITIVE) & ~proposed).sum()),
            "train_slips": int(((kind == Kind.SLIP) & ~proposed).sum()),
            "train_collisions": int(((kind == Kind.COLLISION) & ~proposed).sum()),
            "train_proposals": int(proposed.sum()),
            "train_objects": len(self._names[False]),
            "validation_objects": len(self._names[True]),
            "labels_agree_with_physics": {name: f"{a}/{n}" for name, (a, n) in self._agreement.items()},
            "corrupt_shards": len(self.corrupt),
        }


def is_usable(scene: SceneSample, validation: bool) -> bool:
    """Whether it has positives and negatives of the rule; one of them is enough to learn from a logged attempt."""
    own = scene.kind[~scene.proposed]
    if scene.name.startswith(FROM_TRIAL) and not validation:
        return len(own) > 0
    return bool(np.any(own == Kind.POSITIVE) and np.any(own != Kind.POSITIVE))


def _joined(first: SceneTable | None, more: list[SceneTable]) -> SceneTable | None:
    """All of them as one."""
    tables = ([] if first is None else [first]) + more
    with torch.no_grad():
        return reduce(SceneTable.join, tables) if tables else None
