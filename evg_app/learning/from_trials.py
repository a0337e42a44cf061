"""Training data out of the trial log: what was seen, what was tried, and what became of it."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import MAX_OPENING, VOXEL_SIZE, Array, invert
from evg_app.learning.labels import Kind, WithContact
from evg_app.learning.shards import FROM_TRIAL, SceneSample, quantise, write_shard
from evg_app.learning.views import draw_views
from evg_app.trials import schema
from evg_app.trials.recorded import RecordedRun
from evg_app.trials.rows import LogRows, read_rows
from evg_app.types import Verdict

POINTS = 3072
"""Occupancy samples of a scene, as `generate` makes them."""
UNIFORM_SHARE = 0.7
"""Of the occupancy samples; the others lie near seen surface, and come last."""
MOST_COLLISIONS = 200
"""Refused candidates of one attempt that become examples of collision."""
SLIPPED = ("nothing held after lift", "lost in transit", "not in the bin")
"""Failures in which the fingers closed where they should and did not hold."""
COLLIDED = ("contact on approach",)
VALIDATION_EVERY = 10
"""Every so many-th round is for validation: attempts of one round show the same objects."""


@dataclass(frozen=True)
class Collected:
    """How much came out of the log: attempts used, and of them successes; attempts that teach nothing."""

    used: int
    positives: int
    left_out: int


def shards_from_trials(folders: Sequence[Path], out: Path) -> Collected:
    """Write one shard a run for training and one for validation.

    A success is a positive grasp, with the opening that was measured; a grasp that closed and did not hold a slip; a
    contact on the approach, and a candidate refused for gripper-scene collision, a collision. All other proposals keep
    weak negatives away: nobody knows whether they would have held. An operator's label goes before the automatic one.
    A failure is a scene without a positive: training learns from it, validation leaves it out.

    Raises:
        BadInput: a folder holds no readable log, or `out` cannot be written.
    """
    used = positives = left_out = 0
    for folder in folders:
        scenes: dict[bool, list[SceneSample]] = {False: [], True: []}
        rows, recorded = read_rows(folder), RecordedRun(folder)
        widths = _measured_widths(folder)
        kept = set(recorded.attempt_ids)
        for row in rows.passes:
            kind = _kind(rows, row) if row["counts"] and row["attempt_id"] in kept else None
            if kind is None:
                left_out += bool(row["counts"])
                continue
            stored = recorded.attempt(row["attempt_id"]).stored
            width = widths.get(row["attempt_id"]) if kind is Kind.POSITIVE else None
            scenes[row["round_index"] % VALIDATION_EVERY == VALIDATION_EVERY - 1].append(
                _scene(row["attempt_id"], stored, kind, MAX_OPENING if width is None else width)
            )
            used, positives = used + 1, positives + (kind is Kind.POSITIVE)
        for validation, found in scenes.items():
            if found:
                name = f"shard_trials_{rows.runs[0]['run_id'][:12]}_{'validation' if validation else 'train'}.npz"
                meta = {"validation": validation, "digest": rows.runs[0]["run_id"], "trials": str(folder)}
                write_shard(out / name, found, meta)
    return Collected(used, positives, left_out)


def _kind(rows: LogRows, row: Any) -> Kind | None:
    """What the executed grasp teaches; None for a failure that says nothing about the grasp."""
    if rows.success(row):
        return Kind.POSITIVE
    if row["failure"] in COLLIDED:
        return Kind.COLLISION
    labelled = row["attempt_id"] in rows.labels
    return Kind.SLIP if row["failure"] in SLIPPED or (labelled and not row["failure"]) else None


def _measured_widths(folder: Path) -> dict[str, float]:
    """Opening [m] of the fingers after the lift, by attempt."""
    db = schema.open_existing(folder)
    try:
        query = "SELECT attempt_id, evidence FROM attempts WHERE evidence IS NOT NULL"
        found = {row["attempt_id"]: json.loads(row["evidence"]).get("width_lifted") for row in db.execute(query)}
    finally:
        db.close()
    return {name: float(width) for name, width in found.items() if width is not None}


def _scene(name: str, stored: Any, kind: Kind, width: float) -> SceneSample:
    """An attempt as a scene: the executed grasp first, then the refused candidates."""
    executed = invert(stored["T_base_task"]) @ stored["T_base_grasp"]
    refused = np.flatnonzero(stored["verdict"] == str(Verdict.GRIPPER_COLLISION))[:MOST_COLLISIONS]
    T = np.concatenate([executed[None], stored["T_task_grasp"][refused]])
    n = len(refused)
    contact = {Kind.POSITIVE: WithContact.HOLDS, Kind.SLIP: WithContact.FAILS}.get(kind, WithContact.UNKNOWN)
    unsure = np.ones(len(stored["verdict"]), dtype=np.bool_)
    unsure[refused] = False
    near = [executed[None, :3, 3]] if kind is Kind.POSITIVE else []
    rng = np.random.default_rng(np.frombuffer(name.encode("utf-8"), dtype=np.uint8))
    points, occupied = occupancy(stored["tsdf"], stored["observed"], rng)
    views = len(draw_views(rng))
    return SceneSample(
        grids=np.repeat(quantise(stored["tsdf"])[None], views, axis=0),
        views=("trial/real",) * views,
        rows=T[:, :2, :3].reshape(-1, 6).astype(np.float32),
        position=T[:, :3, 3].astype(np.float32),
        width=np.array([width, *(MAX_OPENING,) * n], dtype=np.float32),
        kind=np.array([kind, *(Kind.COLLISION,) * n], dtype=np.uint8),
        contact=np.array([contact, *(WithContact.UNKNOWN,) * n], dtype=np.uint8),
        proposed=np.zeros(1 + n, dtype=np.bool_),
        positives=np.concatenate([*near, stored["T_task_grasp"][unsure, :3, 3]]).astype(np.float16),
        points=points,
        occupied=occupied,
        name=f"{FROM_TRIAL}{name}",
        objects=(),
    )


def occupancy(
    tsdf: NDArray[np.float32], observed: NDArray[np.bool_], rng: np.random.Generator
) -> tuple[NDArray[np.float16], NDArray[np.bool_]]:
    """Samples in seen voxels and whether the seen surface is in front of them. Shapes (POINTS, 3) [m], (POINTS,).

    A voxel behind a surface has a value in (0, 0.5) (spec §1); what no ray reached is not sampled.
    """
    band = observed & (tsdf > 0)
    inside = band & (tsdf < 0.5)
    everywhere, near = np.flatnonzero(observed), np.flatnonzero(band if band.any() else observed)
    uniform = int(POINTS * UNIFORM_SHARE)
    index = np.concatenate([rng.choice(everywhere, uniform), rng.choice(near, POINTS - uniform)])
    corner = np.stack(np.unravel_index(index, tsdf.shape), axis=1)
    points: Array = (corner + rng.random((POINTS, 3))) * VOXEL_SIZE
    return points.astype(np.float16), inside.reshape(-1)[index]
