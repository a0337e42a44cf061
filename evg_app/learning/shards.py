"""Shards: compressed files of labelled scenes, written whole or not at all (format version 2).

A shard is an .npz with, for S scenes of V views, G grasps and P positive positions in all:
  grids uint8 (S, V, 40, 40, 40): TSDF values * 255, rounded (0 stays 0); views (S, V) names "view/noise";
  rows float32 (G, 6): first two rows of each grasp's rotation; position float32 (G, 3) [m]; width float32 (G,) [m];
  kind uint8 (G,): see labels.Kind; contact uint8 (G,): see labels.WithContact; proposed bool (G,): proposed by a
  network and judged by physics; grasp_start int64 (S + 1,): scene s owns grasps [start[s], start[s+1]);
  positives float16 (P, 3) [m]: positions of ALL positives found, positive_start int64 (S + 1,);
  points float16 (S, N, 3) [m] and occupied bool (S, N): occupancy samples; meta: JSON text.
All in the task frame (spec §1).
"""

import json
import os
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evg_app.errors import BadInput

VERSION = 2
FROM_TRIAL = "trial/"
"""How the names of scenes begin that come out of a trial log."""
"""Format version."""


class CorruptShard(BadInput):
    """A shard cannot be read or has another format version."""


@dataclass(frozen=True)
class SceneSample:
    """Everything training needs of one scene; arrays as in the module's description, without the scene axis.

    Attributes:
        grids, views, rows, position, width, kind, contact, proposed, positives, points, occupied: see the module.
        name: "kind/unit" of the scene.
        objects: names of its objects.
        placement: per object "parent/folder/name", scale and the first three rows of T_task_object, to build it again.
        verified: of each grasp that physics tried as well, the kinds said and found, and contact said and found.
    """

    grids: NDArray[np.uint8]
    views: tuple[str, ...]
    rows: NDArray[np.float32]
    position: NDArray[np.float32]
    width: NDArray[np.float32]
    kind: NDArray[np.uint8]
    contact: NDArray[np.uint8]
    proposed: NDArray[np.bool_]
    positives: NDArray[np.float16]
    points: NDArray[np.float16]
    occupied: NDArray[np.bool_]
    name: str
    objects: tuple[str, ...]
    placement: tuple[tuple[str, float, tuple[float, ...]], ...] = ()
    verified: tuple[tuple[int, int, int, int], ...] = ()


def quantise(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """TSDF values in [0, 1] as bytes; an error of 0.12 mm at most, 0 stays 0."""
    return np.round(values * 255.0).astype(np.uint8)


def write_shard(path: Path, scenes: Sequence[SceneSample], meta: dict[str, Any]) -> None:
    """Write scenes to `path` atomically.

    Raises:
        BadInput: the folder cannot be written.
    """
    described = meta | {
        "version": VERSION,
        "scenes": [_described(s) for s in scenes],
    }
    arrays = {
        "grids": np.stack([s.grids for s in scenes]),
        "views": np.array([s.views for s in scenes]),
        "rows": np.concatenate([s.rows for s in scenes]),
        "position": np.concatenate([s.position for s in scenes]),
        "width": np.concatenate([s.width for s in scenes]),
        "kind": np.concatenate([s.kind for s in scenes]),
        "contact": np.concatenate([s.contact for s in scenes]),
        "proposed": np.concatenate([s.proposed for s in scenes]),
        "grasp_start": np.cumsum([0, *(len(s.kind) for s in scenes)]),
        "positives": np.concatenate([s.positives for s in scenes]),
        "positive_start": np.cumsum([0, *(len(s.positives) for s in scenes)]),
        "points": np.stack([s.points for s in scenes]),
        "occupied": np.stack([s.occupied for s in scenes]),
        "meta": np.array(json.dumps(described)),
    }
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
        temporary.replace(path)
    except OSError as error:
        raise BadInput(f"cannot write shard {path} ({error}); give another --out") from error


def _described(scene: SceneSample) -> dict[str, Any]:
    """What of a scene goes into the meta data."""
    return {
        "name": scene.name,
        "objects": list(scene.objects),
        "placement": scene.placement,
        "verified": scene.verified,
    }


def read_shard(path: Path) -> tuple[list[SceneSample], dict[str, Any]]:
    """The scenes of a shard and its meta data.

    Raises:
        CorruptShard: the file cannot be read or has another version.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
        meta: dict[str, Any] = json.loads(str(arrays["meta"]))
        if meta["version"] != VERSION:
            raise CorruptShard(f"{path} has format version {meta['version']}, expected {VERSION}; generate it again")
        return [_scene(arrays, meta, s) for s in range(len(arrays["grids"]))], meta
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
        raise CorruptShard(f"{path} is not a readable shard ({error}); delete it and run generate again") from error


def _scene(arrays: dict[str, NDArray[Any]], meta: dict[str, Any], s: int) -> SceneSample:
    """Scene `s` of a shard's arrays."""
    own = slice(arrays["grasp_start"][s], arrays["grasp_start"][s + 1])
    return SceneSample(
        grids=arrays["grids"][s],
        views=tuple(str(v) for v in arrays["views"][s]),
        rows=arrays["rows"][own],
        position=arrays["position"][own],
        width=arrays["width"][own],
        kind=arrays["kind"][own],
        contact=arrays["contact"][own],
        proposed=arrays["proposed"][own],
        positives=arrays["positives"][arrays["positive_start"][s] : arrays["positive_start"][s + 1]],
        points=arrays["points"][s],
        occupied=arrays["occupied"][s],
        name=meta["scenes"][s]["name"],
        objects=tuple(meta["scenes"][s]["objects"]),
        placement=tuple((n, c, tuple(t)) for n, c, t in meta["scenes"][s]["placement"]),
        verified=tuple((a, b, c, d) for a, b, c, d in meta["scenes"][s]["verified"]),
    )
