"""Reading a run folder back: what configured it, and every attempt with its arrays."""

import hashlib
import json
import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from evg_app.errors import BadInput
from evg_app.events import Evidence
from evg_app.trials import arrays, schema
from evg_app.trials.provenance import sha256


@dataclass(frozen=True)
class Session:
    """One start of `evg-app run` in a run folder (a resumed run has several).

    Attributes:
        run_id: of this session.
        model, weights_sha256: the planner.
        config: the snapshot of everything that configured it.
        config_intact: whether the snapshot still has the hash it was recorded with.
        provenance: code, packages, machine.
    """

    run_id: str
    model: str
    weights_sha256: str
    config: Mapping[str, Any]
    config_intact: bool
    provenance: Mapping[str, Any]


@dataclass(frozen=True)
class RecordedAttempt:
    """One pass through the loop, as it was logged.

    Attributes:
        attempt_id, run_id, seed, round_index, index, planner_seed, outcome, failure: as in the log.
        stored: its arrays by name (`arrays.py`).
        verified, evidence: the judgement and what it rests on, as in the log.
        intact: whether the arrays file has the hash it was recorded with; None when none was recorded.
    """

    attempt_id: str
    run_id: str
    seed: int
    round_index: int
    index: int
    planner_seed: int
    outcome: str
    failure: str
    stored: Mapping[str, np.ndarray[Any, Any]]
    intact: bool | None
    verified: bool | None = None
    evidence: Evidence = field(default_factory=Evidence)

    @property
    def reached(self) -> tuple[str, ...]:
        """How far the pass came: some of "frame", "fused", "planned", "judged"."""
        if "reached" in self.stored:
            return tuple(str(name) for name in self.stored["reached"])
        judged = len(self.stored["verdict"]) > 0
        came = {"frame": "depth" in self.stored, "fused": "tsdf" in self.stored, "planned": judged, "judged": judged}
        return tuple(name for name, done in came.items() if done)


class RecordedRun:
    """A run folder, for reading. `sessions` by run id; `attempt_ids` of finished passes whose arrays are kept.

    Raises:
        BadInput: the folder holds no readable trial log.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        db = schema.open_existing(folder)
        try:
            self.sessions = {row["run_id"]: _session(row) for row in db.execute("SELECT * FROM runs ORDER BY rowid")}
            kept = "outcome IS NOT NULL AND arrays IS NOT NULL"
            rows = db.execute(f"SELECT * FROM attempts WHERE {kept} ORDER BY rowid").fetchall()
        except (sqlite3.Error, ValueError) as error:
            raise BadInput(f"{folder / schema.DATABASE} cannot be read: {error}") from error
        finally:
            db.close()
        self._rows = {str(row["attempt_id"]): row for row in rows}

    @property
    def attempt_ids(self) -> tuple[str, ...]:
        """In the order they were made."""
        return tuple(self._rows)

    def find(self, text: str) -> str:
        """The attempt whose id begins with `text`.

        Raises:
            BadInput: none does, or several do.
        """
        found = [name for name in self._rows if name.startswith(text)]
        if len(found) == 1:
            return found[0]
        few = ", ".join((found or list(self._rows))[:4]) or "none"
        problem = "several attempts begin" if found else "no attempt begins"
        raise BadInput(f"{problem} with '{text}' in {self.folder}; for example: {few}")

    def attempt(self, attempt_id: str) -> RecordedAttempt:
        """One attempt with its arrays.

        Raises:
            BadInput: the arrays file is missing or unreadable.
        """
        row = self._rows[attempt_id]
        path = self.folder / row["arrays"]
        try:
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            stored = arrays.read(path)
        except (OSError, ValueError, EOFError, KeyError, BadZipFile) as error:
            raise BadInput(f"the arrays of attempt {attempt_id} cannot be read from {path}: {error}") from error
        return RecordedAttempt(
            attempt_id,
            row["run_id"],
            row["seed"],
            row["round_index"],
            row["attempt_index"],
            row["planner_seed"],
            row["outcome"],
            row["failure"] or "",
            stored,
            None if row["arrays_sha256"] is None else row["arrays_sha256"] == digest,
            None if row["verified"] is None else bool(row["verified"]),
            _evidence(row["evidence"]),
        )


def _evidence(text: str) -> Evidence:
    """The evidence as it was logged; of a log of another version, what this one knows of it."""
    known = {name.name for name in fields(Evidence)}
    return Evidence(**{name: value for name, value in json.loads(text).items() if name in known})


def _session(row: sqlite3.Row) -> Session:
    """A row of `runs`."""
    return Session(
        row["run_id"],
        row["model"],
        row["weights_sha256"],
        json.loads(row["config"]),
        sha256(row["config"]) == row["config_sha256"],
        json.loads(row["provenance"]),
    )
