"""The scenes of a folder of shards, in memory; new shards are taken in as they appear."""

import logging
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from evg_app.errors import BadInput
from evg_app.learning.labels import Kind
from evg_app.learning.shards import CorruptShard, SceneSample, read_shard

log = logging.getLogger(__name__)


@dataclass
class SceneStore:
    """Scenes by shard, in the order of the shards' names.

    Attributes:
        folder: where the shards are.
        train, validation: scenes to learn from and to measure on.
        corrupt: shards that could not be read, by name; each is read again when it changes.
    """

    folder: Path
    train: list[SceneSample] = field(default_factory=list)
    validation: list[SceneSample] = field(default_factory=list)
    corrupt: list[str] = field(default_factory=list)
    _seen: dict[str, float] = field(default_factory=dict)

    def refresh(self) -> int:
        """Read shards that are new since the last call. Returns how many were taken in.

        Raises:
            BadInput: the folder does not exist.
        """
        if not self.folder.is_dir():
            raise BadInput(f"data folder {self.folder} does not exist; run evg-app generate --out {self.folder} first")
        taken = 0
        for path in sorted(self.folder.glob("shard_*.npz")):
            stamp = path.stat().st_mtime
            if self._seen.get(path.name) == stamp:
                continue
            self._seen[path.name] = stamp
            taken += self._take(path)
        return taken

    def _take(self, path: Path) -> int:
        """Read one shard; 1 if it could be read."""
        try:
            scenes, meta = read_shard(path)
        except CorruptShard as error:
            self.corrupt.append(path.name)
            log.warning("skipped (%d so far): %s", len(self.corrupt), error)
            return 0
        usable = [s for s in scenes if np.any(s.kind == Kind.POSITIVE) and np.any(s.kind != Kind.POSITIVE)]
        (self.validation if meta["validation"] else self.train).extend(usable)
        return 1

    def describe(self) -> dict[str, object]:
        """Counts for logs and cards."""
        kinds = np.concatenate([s.kind for s in self.train]) if self.train else np.zeros(0, dtype=np.uint8)
        return {
            "train_scenes": len(self.train),
            "validation_scenes": len(self.validation),
            "train_grasps": int(kinds.size),
            "train_positives": int((kinds == Kind.POSITIVE).sum()),
            "train_slips": int((kinds == Kind.SLIP).sum()),
            "train_objects": len({name for s in self.train for name in s.objects}),
            "validation_objects": len({name for s in self.validation for name in s.objects}),
            "corrupt_shards": len(self.corrupt),
        }
