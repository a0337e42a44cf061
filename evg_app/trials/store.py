"""The writer of a run folder: an event sink that commits once per attempt."""

import json
import logging
import sqlite3
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

from evg_app.events import (
    AttemptFinished,
    AttemptStarted,
    DevicesConnected,
    Event,
    RoundFinished,
    RoundStarted,
    RunFinished,
    RunStarted,
    StageTimed,
)
from evg_app.trials import arrays, labels, schema
from evg_app.trials.encode import encode
from evg_app.trials.errors import LogError
from evg_app.trials.folder import ATTEMPTS
from evg_app.trials.provenance import canonical, provenance, sha256

log = logging.getLogger(__name__)

RUN_FILE = "run.json"
"""The row of the last session, readable without SQLite."""
Placement = Callable[[int, int], Mapping[str, Any]]
"""What a round (seed, index) asks of the operator."""


class TrialStore:
    """Writes `trials.sqlite` and `attempts/<id>.npz` as the events come.

    A finished attempt is on the disk before its event returns; a kill at any moment loses at most
    the attempt in progress. Rows wait in memory until then, so that others may write labels meanwhile.

    Args:
        folder: a fresh run folder (`folder.make`), or that of an earlier session to go on with.
        config: JSON-able snapshot of everything that configures the run.
        facts: provenance; looked up when None.
        placement: what the operator was told to place in a round (seed, index), as JSON-able facts.

    Raises:
        LogError: from the constructor and from every event, when the disk does not take it.
        BadInput: the log of an earlier session cannot be gone on with.
    """

    def __init__(
        self,
        folder: Path,
        config: Mapping[str, Any],
        facts: Mapping[str, Any] | None = None,
        placement: Placement | None = None,
    ) -> None:
        self.folder, self.run_id = folder, uuid4().hex
        self._config, self._facts = dict(config), dict(facts if facts is not None else provenance())
        self._placement = placement
        self._number, self._attempt = 0, ""
        self._gathered = arrays.Gathered()
        self._rows: list[tuple[str, Sequence[Any]]] = []
        try:
            exists = (folder / schema.DATABASE).exists()
            self._db = schema.open_to_write(folder) if exists else schema.create(folder)
        except (sqlite3.Error, OSError) as error:
            raise LogError(str(folder), str(error)) from error

    def __call__(self, event: Event) -> None:
        """Take one event."""
        try:
            self._take(event)
        except (sqlite3.Error, OSError) as error:
            raise LogError(str(self.folder), str(error)) from error

    def label(self, attempt_id: str, success: bool | None) -> None:
        """Keep the label that the operator was asked for, of a finished attempt. None for "cannot tell".

        Raises:
            LogError: the disk does not take it.
        """
        try:
            self._add(labels.INSERT, labels.row(attempt_id, success, labels.OPERATOR))
            self._commit()
        except sqlite3.Error as error:
            raise LogError(str(self.folder), str(error)) from error

    def close(self) -> None:
        """Close the database; may be called twice. What still waits is kept if the disk takes it."""
        try:
            self._commit()
        except sqlite3.Error as error:
            log.warning("the last rows of %s are lost: %s", self.folder, error)
        finally:
            self._db.close()

    def _take(self, event: Event) -> None:
        """Turn an event into rows and arrays, and commit where something ended."""
        if isinstance(event, DevicesConnected):
            self._facts["devices"] = {name: dict(told) for name, told in event.devices.items()}
        elif isinstance(event, RunStarted):
            self._run_started(event)
        elif isinstance(event, RoundStarted):
            self._round_started(event)
        elif isinstance(event, AttemptStarted):
            self._attempt_started(event)
        elif isinstance(event, StageTimed) and self._attempt:
            row_ = (self._attempt, str(event.stage.value), event.wall_ms)
            self._add("INSERT INTO stages VALUES (?, ?, ?)", row_)
        self._gathered.take(event)
        self._log(event)
        if isinstance(event, AttemptFinished):
            self._attempt_finished(event)
        elif isinstance(event, (RoundFinished, RunFinished)):
            self._ended(event)
        if isinstance(event, (RunStarted, RoundStarted, AttemptFinished, RoundFinished, RunFinished)):
            self._commit()

    def _add(self, sql: str, values: Sequence[Any]) -> None:
        """Keep a statement for the next commit."""
        self._rows.append((sql, values))

    def _commit(self) -> None:
        """Everything that waits, whole or not at all."""
        rows, self._rows = self._rows, []
        if not rows:
            return
        self._db.execute("BEGIN IMMEDIATE")
        try:
            for sql, values in rows:
                self._db.execute(sql, values)
            self._db.execute("COMMIT")
        except sqlite3.Error:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            raise

    def _log(self, event: Event) -> None:
        """Keep the event itself."""
        self._add(
            "INSERT INTO events VALUES (?, ?, ?, ?, ?, ?)",
            (self.run_id, self._number, self._attempt or None, type(event).__name__, _now(), encode(event)),
        )
        self._number += 1

    def _run_started(self, event: RunStarted) -> None:
        """A row of `runs`, and run.json."""
        config = canonical(self._config)
        protocol = self._config.get("protocol")
        row = {
            "run_id": self.run_id,
            "started_at": _now(),
            "seeds": json.dumps(event.seeds),
            "rounds": event.rounds,
            "model": event.model,
            "weights_sha256": event.weights_sha256,
            "config": config,
            "config_sha256": sha256(config),
            "provenance": json.dumps(self._facts),
            "protocol": protocol["name"] if protocol else None,
        }
        names = ", ".join(row)
        self._add(f"INSERT INTO runs ({names}) VALUES ({', '.join('?' * len(row))})", tuple(row.values()))
        readable = {**row, "seeds": list(event.seeds), "config": json.loads(config), "provenance": self._facts}
        arrays.write_json(self.folder / RUN_FILE, {"schema_version": schema.SCHEMA_VERSION, **readable})

    def _round_started(self, event: RoundStarted) -> None:
        """A row of `rounds`; an earlier one of the same name no longer counts."""
        placement = None
        if self._placement is not None:
            placement = json.dumps(self._placement(event.seed, event.round_index))
        again = "UPDATE rounds SET superseded = 1 WHERE seed = ? AND round_index = ?"
        self._add(again, (event.seed, event.round_index))
        row = (self.run_id, event.seed, event.round_index, event.objects, placement)
        names = "run_id, seed, round_index, objects, placement"
        self._add(f"INSERT INTO rounds ({names}) VALUES (?, ?, ?, ?, ?)", row)

    def _attempt_started(self, event: AttemptStarted) -> None:
        """A row of `attempts`."""
        self._attempt, self._gathered = event.attempt_id, arrays.Gathered()
        self._add(
            "INSERT INTO attempts (attempt_id, run_id, seed, round_index, attempt_index, planner_seed)"
            " VALUES (?, ?, ?, ?, ?, ?)",
            (event.attempt_id, self.run_id, event.seed, event.round_index, event.index, event.planner_seed),
        )

    def _attempt_finished(self, event: AttemptFinished) -> None:
        """Write the arrays, then fill in the row."""
        name = f"{ATTEMPTS}/{event.attempt_id}.npz"
        digest = arrays.write(self.folder / name, self._gathered)
        judged, grasps = self._gathered.judged, self._gathered.grasps
        chosen = None if judged is None else judged.chosen
        values = {
            "outcome": str(event.outcome.value),
            "counts": int(event.outcome.counts),
            "verified": event.verified,
            "truth": event.truth,
            "failure": event.failure,
            "evidence": json.dumps(asdict(event.evidence)),
            "motion_s": event.motion_s,
            "compute_ms": event.compute_ms,
            "candidates": len(grasps),
            "chosen": chosen,
            "flipped": None if judged is None or chosen is None else judged.flipped,
            "score": None if chosen is None else float(grasps.score[chosen]),
            "width_m": None if chosen is None else float(grasps.width[chosen]),
            "arrays": name,
            "arrays_sha256": digest,
        }
        sets = ", ".join(f"{column} = ?" for column in values)
        self._add(f"UPDATE attempts SET {sets} WHERE attempt_id = ?", (*values.values(), event.attempt_id))
        counted = Counter(str(v.value) for v in judged.verdicts) if judged is not None else Counter[str]()
        for verdict, n in counted.items():
            self._add("INSERT INTO verdicts VALUES (?, ?, ?)", (event.attempt_id, verdict, n))
        self._attempt, self._gathered = "", arrays.Gathered()

    def _ended(self, event: RoundFinished | RunFinished) -> None:
        """How a round or the run ended."""
        if isinstance(event, RoundFinished):
            self._add(
                "UPDATE rounds SET stop_reason = ?, detail = ? WHERE run_id = ? AND seed = ? AND round_index = ?",
                (str(event.stop_reason.value), event.detail, self.run_id, event.seed, event.round_index),
            )
            return
        self._add(
            "UPDATE runs SET finished_at = ?, status = ?, detail = ? WHERE run_id = ?",
            (_now(), event.status, event.detail, self.run_id),
        )


def _now() -> str:
    """Wall time for people, UTC, to the millisecond."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
