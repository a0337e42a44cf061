"""Scenes as tensors of equal rows, on the device that trains: a batch is a few gathers."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from evg_app.learning.shards import SceneSample

GRASPS, POSITIVES = 320, 768
"""Rows kept of a scene's grasps, and of the positions of all its positives; the rest of these is left out."""
NO_KIND = 255
"""Kind of an empty row."""
NOWHERE = 100.0
"""Coordinate of an empty position [m]: far from everything."""


@dataclass(frozen=True)
class SceneTable:
    """S scenes of V views; empty rows have kind `NO_KIND` or lie `NOWHERE`. As in `shards`, task frame, [m].

    Attributes:
        grids: TSDF values * 255. (S, V, 40, 40, 40) uint8.
        rows, position, width, kind, contact, proposed: grasps. (S, GRASPS, ...).
        positives: (S, POSITIVES, 3) float16.
        points, occupied: (S, N, 3) float16, (S, N) bool.
    """

    grids: Tensor
    rows: Tensor
    position: Tensor
    width: Tensor
    kind: Tensor
    contact: Tensor
    proposed: Tensor
    positives: Tensor
    points: Tensor
    occupied: Tensor

    @property
    def scenes(self) -> int:
        """How many."""
        return self.grids.shape[0]

    @property
    def views(self) -> int:
        """Stored views of each scene."""
        return self.grids.shape[1]

    def join(self, other: "SceneTable") -> "SceneTable":
        """These scenes followed by the others."""
        return SceneTable(**{f.name: torch.cat([getattr(self, f.name), getattr(other, f.name)]) for f in fields(self)})


def table_of(scenes: Sequence[SceneSample], device: torch.device | str = "cpu") -> SceneTable:
    """The table of some scenes."""

    def stacked(name: str, rows: int, empty: float) -> Tensor:
        """One field of all scenes, filled up with `empty` to `rows` rows."""
        padded = [_padded(getattr(s, name), rows, empty) for s in scenes]
        return torch.from_numpy(np.stack(padded)).to(device)

    return SceneTable(
        grids=torch.from_numpy(np.stack([s.grids for s in scenes])).to(device),
        rows=stacked("rows", GRASPS, 0.0),
        position=stacked("position", GRASPS, NOWHERE),
        width=stacked("width", GRASPS, 0.0),
        kind=stacked("kind", GRASPS, NO_KIND),
        contact=stacked("contact", GRASPS, 0),
        proposed=stacked("proposed", GRASPS, 0),
        positives=stacked("positives", POSITIVES, NOWHERE),
        points=torch.from_numpy(np.stack([s.points for s in scenes])).to(device),
        occupied=torch.from_numpy(np.stack([s.occupied for s in scenes])).to(device),
    )


def _padded(values: NDArray[np.generic], rows: int, empty: float) -> NDArray[np.generic]:
    """The first `rows` rows, evenly chosen where there are more, filled up where there are fewer."""
    if len(values) > rows:
        values = values[np.linspace(0, len(values) - 1, rows).astype(np.int64)]
    full = np.full((rows, *values.shape[1:]), empty, dtype=values.dtype)
    full[: len(values)] = values
    return full
