"""The writer of a run folder: an event sink that commits once per attempt."""

import json
import sqlite3
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

from evg_app.events import (
    AttemptFinished,
    AttemptStarted,
    Event,
    RoundFinished,
    RoundStarted,
    RunFinished,
    RunStarted,
    StageTimed,
)
from evg_app.trials import arrays, schema
from evg_app.trials.encode import encode
from evg_app.trials.errors import LogError
from evg_app.trials.folder import ATTEMPTS
from evg_app.trials.provenance import canonical, provenance, sha256

RUN_FILE = "run.json"
"""The run's row, readable without SQLite."""


class TrialStore:
    """Writes `trials.sqlite` and `attempts/<id>.npz` as the events come.

    A finished attempt is on the disk before its event returns; a kill at any moment loses at most
    the attempt in progress. `folder` is a fresh run folder (`folder.make`), `config` a JSON-able snapshot.

    Raises:
        LogError: from the constructor and from every event, when the disk does not take it.
    """

    def __init__(self, folder: Path, config: Mapping[str, Any], facts: Mapping[str, Any] | None = None) -> None:
        self.folder, self.run_id = folder, uuid4().hex
        self._config, self._facts = canonical(config), dict(facts if facts is not None else provenance())
        self._number, self._attempt = 0, ""
        self._gathered = arrays.Gathered()
        try:
            self._db = schema.create(folder)
        except (sqlite3.Error, OSError) as error:
            raise LogError(str(folder), str(error)) from error

    def __call__(self, event: Event) -> None:
        """Take one event."""
        try:
            self._take(event)
        except (sqlite3.Error, OSError) as error:
            raise LogError(str(self.folder), str(error)) from error

    def close(self) -> None:
        """Close the database; may be called twice."""
        try:
            self._commit()
            self._db.close()
        except sqlite3.Error:
            self._db.close()

    def _take(self, event: Event) -> None:
        if not self._db.in_transaction:
            self._db.execute("BEGIN")
        if isinstance(event, RunStarted):
            self._run_started(event)
        elif isinstance(event, RoundStarted):
            row = (self.run_id, event.seed, event.round_index, event.objects)
            self._db.execute("INSERT INTO rounds (run_id, seed, round_index, objects) VALUES (?, ?, ?, ?)", row)
        elif isinstance(event, AttemptStarted):
            self._attempt_started(event)
        elif isinstance(event, StageTimed) and self._attempt:
            row_ = (self._attempt, str(event.stage.value), event.wall_ms)
            self._db.execute("INSERT INTO stages VALUES (?, ?, ?)", row_)
        self._gathered.take(event)
        self._log(event)
        if isinstance(event, AttemptFinished):
            self._attempt_finished(event)
        elif isinstance(event, (RoundFinished, RunFinished)):
            self._ended(event)
        if isinstance(event, (RunStarted, RoundStarted, AttemptFinished, RoundFinished, RunFinished)):
            self._commit()

    def _commit(self) -> None:
        if self._db.in_transaction:
            self._db.execute("COMMIT")

    def _log(self, event: Event) -> None:
        self._db.execute(
            "INSERT INTO events VALUES (?, ?, ?, ?, ?, ?)",
            (self.run_id, self._number, self._attempt or None, type(event).__name__, _now(), encode(event)),
        )
        self._number += 1

    def _run_started(self, event: RunStarted) -> None:
        row = {
            "run_id": self.run_id,
            "started_at": _now(),
            "seeds": json.dumps(event.seeds),
            "rounds": event.rounds,
            "model": event.model,
            "weights_sha256": event.weights_sha256,
            "config": self._config,
            "config_sha256": sha256(self._config),
            "provenance": json.dumps(self._facts),
        }
        names = ", ".join(row)
        self._db.execute(f"INSERT INTO runs ({names}) VALUES ({', '.join('?' * len(row))})", tuple(row.values()))
        readable = {**row, "seeds": list(event.seeds), "config": json.loads(self._config), "provenance": self._facts}
        arrays.write_json(self.folder / RUN_FILE, {"schema_version": schema.SCHEMA_VERSION, **readable})

    def _attempt_started(self, event: AttemptStarted) -> None:
        self._attempt, self._gathered = event.attempt_id, arrays.Gathered()
        self._db.execute(
            "INSERT INTO attempts (attempt_id, run_id, seed, round_index, attempt_index, planner_seed)"
            " VALUES (?, ?, ?, ?, ?, ?)",
            (event.attempt_id, self.run_id, event.seed, event.round_index, event.index, event.planner_seed),
        )

    def _attempt_finished(self, event: AttemptFinished) -> None:
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
        self._db.execute(f"UPDATE attempts SET {sets} WHERE attempt_id = ?", (*values.values(), event.attempt_id))
        counted = Counter(str(v.value) for v in judged.verdicts) if judged is not None else Counter[str]()
        rows = [(event.attempt_id, verdict, n) for verdict, n in counted.items()]
        self._db.executemany("INSERT INTO verdicts VALUES (?, ?, ?)", rows)
        self._attempt, self._gathered = "", arrays.Gathered()

    def _ended(self, event: RoundFinished | RunFinished) -> None:
        if isinstance(event, RoundFinished):
            self._db.execute(
                "UPDATE rounds SET stop_reason = ?, detail = ? WHERE run_id = ? AND seed = ? AND round_index = ?",
                (str(event.stop_reason.value), event.detail, self.run_id, event.seed, event.round_index),
            )
            return
        self._db.execute(
            "UPDATE runs SET finished_at = ?, status = ?, detail = ? WHERE run_id = ?",
            (_now(), event.status, event.detail, self.run_id),
        )


def _now() -> str:
    """Wall time for people, UTC, to the millisecond."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
