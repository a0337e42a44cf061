"""Replay: is what the code computes from the logged depth the same, to the bit, as what was logged?"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

import numpy as np

from evg_app.errors import EvgError
from evg_app.trials.arrays import Gathered
from evg_app.trials.recorded import RecordedAttempt, Session

Stored = Mapping[str, np.ndarray[Any, Any]]


class ReplayStage(StrEnum):
    """Where a replay can first differ, in the order of the loop; `LOG` last: only the file's hash is off."""

    CONFIGURATION = "configuration"
    WEIGHTS = "weights"
    PERCEPTION = "perception"
    PLANNING = "planning"
    FEASIBILITY = "feasibility"
    MOTION = "motion"
    ROUTES = "routes"
    VERIFICATION = "verification"
    LOG = "log"


NAMES = {
    ReplayStage.PERCEPTION: ("depth_factor", "points", "tsdf", "observed", "volume_"),
    ReplayStage.PLANNING: ("T_task_grasp", "width", "score"),
    ReplayStage.FEASIBILITY: ("verdict", "chosen", "flipped", "T_base_grasp"),
    ReplayStage.MOTION: ("reach.", "approach.", "lift.", "transport.", "back.", "retreat."),
    ReplayStage.ROUTES: ("routes.",),
}
"""Arrays of each stage; a name that ends in `_` or `.` is a beginning."""
NEEDS = {
    ReplayStage.PERCEPTION: "fused",
    ReplayStage.PLANNING: "planned",
    ReplayStage.FEASIBILITY: "judged",
    ReplayStage.MOTION: "judged",
    ReplayStage.ROUTES: "fused",
}
"""How far a pass must have come for a stage to be compared."""


class Pipeline(Protocol):
    """The code under replay."""

    @property
    def weights_sha256(self) -> str:
        """Of the planner, empty without weights."""

    def recompute(self, attempt: RecordedAttempt) -> Gathered:
        """Perception, planning, feasibility and routes from what was logged, as far as the attempt came.

        Raises:
            EvgError: the loop refuses the frame.
        """

    def verified(self, attempt: RecordedAttempt) -> bool | None:
        """The judgement on the logged evidence; None where there is none."""


@dataclass(frozen=True)
class Difference:
    """One thing that is not the same."""

    stage: ReplayStage
    what: str


@dataclass(frozen=True)
class Replayed:
    """What a replay found.

    Attributes:
        attempt_id: which attempt.
        differences: in the order of the stages; empty when identical.
        compared: names of the arrays that were compared.
    """

    attempt_id: str
    differences: tuple[Difference, ...]
    compared: tuple[str, ...] = ()

    @property
    def identical(self) -> bool:
        """Whether nothing differs."""
        return not self.differences

    @property
    def first(self) -> ReplayStage | None:
        """The first stage that differs."""
        return self.differences[0].stage if self.differences else None


def replay(attempt: RecordedAttempt, session: Session, pipeline: Pipeline) -> Replayed:
    """Recompute one attempt and compare every array bit by bit."""
    before: list[Difference] = []
    if not session.config_intact:
        before.append(Difference(ReplayStage.CONFIGURATION, "the logged configuration no longer has its logged hash"))
    if pipeline.weights_sha256 != session.weights_sha256:
        words = [sha[:12] or "none" for sha in (session.weights_sha256, pipeline.weights_sha256)]
        before.append(Difference(ReplayStage.WEIGHTS, f"recorded with sha256 {words[0]}, replayed with {words[1]}"))
    after = []
    if attempt.intact is False:
        after.append(Difference(ReplayStage.LOG, "the arrays file was changed after it was recorded"))
    try:
        now = pipeline.recompute(attempt).arrays()
    except EvgError as error:
        refused = Difference(ReplayStage.PERCEPTION, f"the loop refuses what it once took: {error}")
        return Replayed(attempt.attempt_id, (*before, refused, *after))
    found, compared = compare(attempt, now)
    verified = pipeline.verified(attempt)
    if verified != attempt.verified:
        what = f"verified: {attempt.verified} became {verified}, from the same evidence"
        found.append(Difference(ReplayStage.VERIFICATION, what))
    return Replayed(attempt.attempt_id, (*before, *found, *after), compared)


def compare(attempt: RecordedAttempt, now: Stored) -> tuple[list[Difference], tuple[str, ...]]:
    """Differences stage by stage, and the names that were compared."""
    differences, compared = [], []
    for stage, prefixes in NAMES.items():
        if NEEDS[stage] not in attempt.reached:
            continue
        for name in sorted(n for n in set(attempt.stored) | set(now) if _belongs(n, prefixes)):
            if name.startswith("volume_") and name not in attempt.stored:
                continue  # logs of schema 1 have no volume
            if name == "points" and name not in attempt.stored:
                continue
            compared.append(name)
            text = difference(attempt.stored.get(name), now.get(name))
            if text:
                differences.append(Difference(stage, f"{name}: {text}"))
    return differences, tuple(compared)


def _belongs(name: str, prefixes: tuple[str, ...]) -> bool:
    """Whether an array is one of a stage."""
    return any(name.startswith(p) if p.endswith(("_", ".")) else name == p for p in prefixes)


def difference(logged: np.ndarray[Any, Any] | None, now: np.ndarray[Any, Any] | None) -> str:
    """How two arrays differ, in words; empty when every bit is the same."""
    if logged is None or now is None:
        return "not computed any more" if now is None else "not in the log"
    logged, now = np.asarray(logged), np.asarray(now)
    if logged.shape != now.shape:
        return f"shape {logged.shape} became {now.shape}"
    if logged.dtype.kind == "U" or now.dtype.kind == "U":
        changed = int((logged != now).sum())
        return f"{changed} of {logged.size} entries" if changed else ""
    if logged.dtype != now.dtype:
        return f"type {logged.dtype} became {now.dtype}"
    if logged.tobytes() == now.tobytes():
        return ""
    with np.errstate(invalid="ignore"):
        gap = np.abs(logged.astype(np.float64) - now.astype(np.float64))
    changed = int(np.sum(~((logged == now) | (np.isnan(gap) & np.isnan(logged.astype(np.float64))))))
    largest = float(np.nanmax(gap)) if not np.isnan(gap).all() else float("nan")
    return f"{changed} of {logged.size} values, largest difference {largest:.3g}"


def environment_changes(recorded: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What is different about code, packages, machine and threads: why a replay may differ."""
    changes = []
    for key in ("git_commit", "python", "platform", "machine", "cpu", "threads"):
        if key in recorded and recorded[key] != now.get(key):
            changes.append(f"{key}: {recorded[key]} became {now.get(key)}")
    before, after = recorded.get("packages", {}), now.get("packages", {})
    for name in sorted(set(before) | set(after)):
        if before.get(name) != after.get(name):
            changes.append(f"{name}: {before.get(name, 'absent')} became {after.get(name, 'absent')}")
    return changes
