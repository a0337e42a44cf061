"""The rows of a run folder that statistics are made of."""

import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from evg_app.errors import BadInput
from evg_app.events import AttemptOutcome
from evg_app.trials import schema
from evg_app.trials.compare import Counts
from evg_app.trials.labels import OPERATOR

SUCCESS = str(AttemptOutcome.SUCCESS)
RoundKey = tuple[str, int, int]
"""Run id, seed, round index."""

_PASSES = """
SELECT a.attempt_id, a.run_id, a.seed, a.round_index, a.attempt_index, a.outcome, a.counts, a.verified, a.truth,
    a.failure, a.motion_s, a.compute_ms, a.candidates, a.chosen, a.score, a.width_m, a.arrays
FROM attempts a JOIN rounds r ON r.run_id = a.run_id AND r.seed = a.seed AND r.round_index = a.round_index
WHERE a.outcome IS NOT NULL AND r.superseded = 0 ORDER BY a.rowid
"""
_LABELS = "SELECT attempt_id, success, source FROM labels ORDER BY rowid"
_ATTEMPTS = """
SELECT a.attempt_id FROM attempts a
JOIN rounds r ON r.run_id = a.run_id AND r.seed = a.seed AND r.round_index = a.round_index WHERE r.superseded
"""
_VERDICTS = f"""
SELECT verdict, SUM(candidates) FROM verdicts WHERE attempt_id NOT IN ({_ATTEMPTS} = 1)
GROUP BY verdict ORDER BY 2 DESC, 1
"""
_REFUSED = f"""
SELECT attempt_id, verdict, candidates FROM verdicts
WHERE attempt_id IN ({_ATTEMPTS} = 0 AND a.outcome = ?) ORDER BY rowid
"""
_STAGES = "SELECT attempt_id, stage, wall_ms FROM stages ORDER BY rowid"


@dataclass(frozen=True)
class Label:
    """What a person said about an attempt.

    Attributes:
        success: None for "cannot tell".
        asked: whether a protocol asked for it, so that it was the loop's truth.
    """

    success: bool | None
    asked: bool


@dataclass(frozen=True)
class LogRows:
    """One run folder.

    Attributes:
        folder: it.
        runs: one row a session, the first one first.
        rounds: those that count: a round that was begun again after an interruption is left out.
        passes: finished passes of these rounds.
        stages: (attempt_id, stage, wall_ms).
        verdicts: candidates by verdict, most frequent first.
        refused: the same by attempt, of passes without a feasible grasp.
        labels: the operator's last word, by attempt.
        superseded: how many rounds were begun again.
    """

    folder: Path
    runs: Sequence[sqlite3.Row]
    rounds: Sequence[sqlite3.Row]
    passes: Sequence[sqlite3.Row]
    stages: Sequence[tuple[str, str, float]]
    verdicts: Mapping[str, int]
    refused: Mapping[str, Mapping[str, int]]
    labels: Mapping[str, Label]
    superseded: int

    def success(self, row: sqlite3.Row) -> bool:
        """Whether a pass put an object into the bin: the operator's word where there is one."""
        label = self.labels.get(row["attempt_id"]) if self.labels else None
        if row["counts"] and label is not None and label.success is not None:
            return label.success
        return self.automatic_success(row)

    def automatic_success(self, row: sqlite3.Row) -> bool:
        """What the loop made of a pass without a person's word."""
        label = self.labels.get(row["attempt_id"]) if self.labels else None
        if label is not None and label.asked:
            return bool(row["verified"])
        return bool(row["outcome"] == SUCCESS)

    @cached_property
    def by_round(self) -> dict[RoundKey, list[sqlite3.Row]]:
        """Passes of every round that counts, in its order."""
        found: dict[RoundKey, list[sqlite3.Row]] = {key(row): [] for row in self.rounds}
        for row in self.passes:
            found[key(row)].append(row)
        return found

    @cached_property
    def gsr_counts(self) -> Counts:
        """Successful grasps of executed ones, by round."""
        rounds = self.by_round
        return Counts(
            tuple(sum(self.success(p) for p in passes if p["counts"]) for passes in rounds.values()),
            tuple(sum(p["counts"] for p in passes) for passes in rounds.values()),
            tuple((seed, index) for _, seed, index in rounds),
        )

    @cached_property
    def dr_counts(self) -> Counts | None:
        """Objects removed of those on the table, by round; None when nobody counted the objects."""
        if not self.rounds or any(row["objects"] is None for row in self.rounds):
            return None
        gsr = self.gsr_counts
        objects = tuple(int(row["objects"]) for row in self.rounds)
        return Counts(tuple(min(k, n) for k, n in zip(gsr.successes, objects, strict=True)), objects, gsr.rounds)

    def outcomes(self) -> list[bool]:
        """Success of every executed grasp, in the order they were made."""
        return [self.success(row) for row in self.passes if row["counts"]]


def key(row: sqlite3.Row) -> RoundKey:
    """The round that a row belongs to."""
    return row["run_id"], row["seed"], row["round_index"]


def read_rows(folder: Path) -> LogRows:
    """Read a run folder.

    Raises:
        BadInput: it holds no readable trial log.
    """
    db = schema.open_existing(folder)
    try:
        runs = db.execute("SELECT * FROM runs ORDER BY rowid").fetchall()
        rounds = db.execute("SELECT * FROM rounds WHERE superseded = 0 ORDER BY rowid").fetchall()
        superseded = int(db.execute("SELECT COUNT(*) FROM rounds WHERE superseded = 1").fetchone()[0])
        passes = db.execute(_PASSES).fetchall()
        labels: dict[str, Label] = {}
        for attempt_id, success, source in db.execute(_LABELS):
            asked = source == OPERATOR or (attempt_id in labels and labels[attempt_id].asked)
            labels[attempt_id] = Label(None if success is None else bool(success), asked)
        db.row_factory = None
        verdicts = dict(db.execute(_VERDICTS).fetchall())
        refused: dict[str, dict[str, int]] = {}
        for attempt_id, verdict, n in db.execute(_REFUSED, (str(AttemptOutcome.NO_FEASIBLE),)):
            refused.setdefault(attempt_id, {})[verdict] = n
        stages = db.execute(_STAGES).fetchall()
    except sqlite3.Error as error:
        raise BadInput(f"{folder / schema.DATABASE} cannot be read: {error}") from error
    finally:
        db.close()
    if not runs:
        raise BadInput(f"{folder} holds a trial log without a run: it was interrupted while starting")
    return LogRows(folder, runs, rounds, passes, stages, verdicts, refused, labels, superseded)
