"""How much of a run is kept: rows always, arrays and pictures as long as the lab wants them."""

import sqlite3
from collections.abc import Callable, Mapping
from pathlib import Path

from evg_app.errors import BadInput
from evg_app.trials import schema
from evg_app.trials.folder import ATTEMPTS
from evg_app.trials.rows import LogRows, read_rows

POLICIES: Mapping[str, Callable[[LogRows, sqlite3.Row], bool]] = {
    "executed": lambda rows, row: bool(row["counts"]),
    "failures": lambda rows, row: bool(row["counts"]) and not rows.success(row),
    "labelled": lambda rows, row: row["attempt_id"] in rows.labels,
    "none": lambda rows, row: False,
}
"""Passes whose arrays stay: those with an executed grasp, failed ones, labelled ones, none."""


def sizes(folder: Path) -> dict[str, int]:
    """Bytes on the disk: rows, arrays, pictures, and how many attempts have arrays."""
    attempts = folder / ATTEMPTS
    arrays = [path.stat().st_size for path in attempts.glob("*.npz")]
    pictures = [path.stat().st_size for path in attempts.glob("*.png")]
    rows = sum(path.stat().st_size for path in folder.glob(f"{schema.DATABASE}*"))
    return {"rows": rows, "arrays": sum(arrays), "pictures": sum(pictures), "attempts_with_arrays": len(arrays)}


def prune(folder: Path, policy: str) -> tuple[int, int]:
    """Delete the arrays that a policy of `POLICIES` does not keep; how many files, and how many bytes.

    Rows and pictures stay; the row says that its arrays are gone before the file goes.

    Raises:
        BadInput: the log cannot be read or written.
    """
    rows = read_rows(folder)
    keep = POLICIES[policy]
    gone = [row for row in rows.passes if row["arrays"] is not None and not keep(rows, row)]
    db = schema.open_to_write(folder)
    try:
        db.execute("BEGIN IMMEDIATE")
        names = [(row["attempt_id"],) for row in gone]
        db.executemany("UPDATE attempts SET arrays = NULL WHERE attempt_id = ?", names)
        db.execute("COMMIT")
        freed = 0
        for row in gone:
            path = folder / row["arrays"]
            freed += path.stat().st_size if path.exists() else 0
            path.unlink(missing_ok=True)
    except (sqlite3.Error, OSError) as error:
        raise BadInput(f"{folder} cannot be thinned out: {error}") from error
    finally:
        db.close()
    return len(gone), freed
