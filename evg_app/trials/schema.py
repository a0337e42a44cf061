"""The tables of `trials.sqlite`, and how they are opened."""

import sqlite3
from pathlib import Path

from evg_app.errors import BadInput

DATABASE = "trials.sqlite"
"""Name of the database in a run folder."""

FIRST_TABLES = """
CREATE TABLE runs (
    run_id TEXT PRIMARY KEY, started_at TEXT NOT NULL, finished_at TEXT, status TEXT, detail TEXT,
    seeds TEXT NOT NULL, rounds INTEGER NOT NULL, model TEXT NOT NULL, weights_sha256 TEXT NOT NULL,
    config TEXT NOT NULL, config_sha256 TEXT NOT NULL, provenance TEXT NOT NULL
);
CREATE TABLE rounds (
    run_id TEXT NOT NULL REFERENCES runs, seed INTEGER NOT NULL, round_index INTEGER NOT NULL,
    objects INTEGER, stop_reason TEXT, detail TEXT,
    PRIMARY KEY (run_id, seed, round_index)
);
CREATE TABLE attempts (
    attempt_id TEXT PRIMARY KEY, run_id TEXT NOT NULL REFERENCES runs,
    seed INTEGER NOT NULL, round_index INTEGER NOT NULL, attempt_index INTEGER NOT NULL,
    planner_seed INTEGER NOT NULL, outcome TEXT, counts INTEGER, verified INTEGER, truth INTEGER, failure TEXT,
    evidence TEXT, motion_s REAL, compute_ms REAL, candidates INTEGER, chosen INTEGER, flipped INTEGER,
    score REAL, width_m REAL, arrays TEXT
);
CREATE TABLE stages (attempt_id TEXT NOT NULL REFERENCES attempts, stage TEXT NOT NULL, wall_ms REAL NOT NULL);
CREATE TABLE verdicts (
    attempt_id TEXT NOT NULL REFERENCES attempts, verdict TEXT NOT NULL, candidates INTEGER NOT NULL,
    PRIMARY KEY (attempt_id, verdict)
);
CREATE TABLE events (
    run_id TEXT NOT NULL REFERENCES runs, number INTEGER NOT NULL, attempt_id TEXT, kind TEXT NOT NULL,
    at TEXT NOT NULL, data TEXT NOT NULL, PRIMARY KEY (run_id, number)
);
"""
"""Version 1. Units are in the names; `counts` is 1 for passes that are attempts; docs/trials.md explains the rest."""

MIGRATIONS: tuple[str, ...] = (
    """
ALTER TABLE runs ADD COLUMN protocol TEXT;
ALTER TABLE rounds ADD COLUMN placement TEXT;
ALTER TABLE rounds ADD COLUMN superseded INTEGER NOT NULL DEFAULT 0;
ALTER TABLE attempts ADD COLUMN arrays_sha256 TEXT;
CREATE TABLE labels (
    attempt_id TEXT NOT NULL REFERENCES attempts, at TEXT NOT NULL, source TEXT NOT NULL,
    success INTEGER, note TEXT NOT NULL DEFAULT ''
);
CREATE INDEX labels_of_attempt ON labels (attempt_id);
CREATE INDEX stages_of_attempt ON stages (attempt_id);
CREATE INDEX attempts_of_round ON attempts (run_id, seed, round_index);
""",
)
"""What makes version n + 2 of version n + 1. Never edited once released, only appended to."""

SCHEMA_VERSION = 1 + len(MIGRATIONS)
"""Written to `PRAGMA user_version`; a reader refuses a newer one."""


def create(folder: Path) -> sqlite3.Connection:
    """A new, empty database; every commit reaches the disk (WAL, synchronous FULL).

    Raises:
        sqlite3.Error: it cannot be written.
    """
    db = _durable(folder / DATABASE)
    db.executescript(f"BEGIN; {FIRST_TABLES} PRAGMA user_version = 1; COMMIT;")
    migrate(db)
    return db


def migrate(db: sqlite3.Connection) -> None:
    """Bring a database to `SCHEMA_VERSION`; each step happens whole or not at all.

    Raises:
        sqlite3.Error: it cannot be written.
    """
    version = int(db.execute("PRAGMA user_version").fetchone()[0])
    for number, script in enumerate(MIGRATIONS[version - 1 :], version + 1):
        db.executescript(f"BEGIN; {script} PRAGMA user_version = {number}; COMMIT;")


def open_to_write(folder: Path) -> sqlite3.Connection:
    """The database of a run, for appending; an older one is migrated where it lies.

    Raises:
        BadInput: there is none, it is not ours, it is newer, or it cannot be written.
    """
    open_existing(folder).close()
    try:
        db = _durable(folder / DATABASE)
        migrate(db)
    except sqlite3.Error as error:
        raise BadInput(f"{folder / DATABASE} cannot be written: {error}. Make the folder writable") from error
    db.row_factory = sqlite3.Row
    return db


def open_existing(folder: Path) -> sqlite3.Connection:
    """The database of a run, for reading. An older one is migrated in memory; the file stays as it is.

    Raises:
        BadInput: there is none, it is not ours, or it is newer than this program.
    """
    path = folder / DATABASE
    if not path.is_file():
        raise BadInput(f"{folder} holds no trial log ({DATABASE}). Run: evg-app run --sim --run-dir DIR")
    try:
        db, version = _connect(path)
    except sqlite3.Error as error:
        raise BadInput(f"{path} is not a trial log: {error}") from error
    if not 1 <= version <= SCHEMA_VERSION:
        db.close()
        raise BadInput(f"{path} has schema version {version}; this evg-app reads 1 to {SCHEMA_VERSION}. Update it")
    if version < SCHEMA_VERSION:
        db = _migrated_copy(db)
    db.row_factory = sqlite3.Row
    return db


def _durable(path: Path) -> sqlite3.Connection:
    """A connection whose commits reach the disk."""
    db = sqlite3.connect(path, isolation_level=None)
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("PRAGMA synchronous = FULL")
    return db


def _migrated_copy(db: sqlite3.Connection) -> sqlite3.Connection:
    """The database in memory, brought to this version."""
    copy = sqlite3.connect(":memory:", isolation_level=None)
    db.backup(copy)
    db.close()
    migrate(copy)
    return copy


def _connect(path: Path) -> tuple[sqlite3.Connection, int]:
    """The database and its schema version; as an unchanging file where nothing can be written beside it."""
    try:
        return _checked(sqlite3.connect(path))
    except sqlite3.OperationalError:
        return _checked(sqlite3.connect(f"{path.resolve().as_uri()}?immutable=1", uri=True))


def _checked(db: sqlite3.Connection) -> tuple[sqlite3.Connection, int]:
    """The connection with its schema version, once it could be read."""
    try:
        db.execute("PRAGMA query_only = ON")
        return db, int(db.execute("PRAGMA user_version").fetchone()[0])
    except sqlite3.Error:
        db.close()
        raise
