"""What people say about attempts, kept beside the automatic label and never over it."""

import sqlite3
from datetime import UTC, datetime
from pathlib import Path

from evg_app.errors import BadInput
from evg_app.trials import schema

OPERATOR = "operator"
"""Source of a label that a protocol asked for. It was the loop's truth, so the automatic label is verify's."""
VIEWER = "viewer"
"""Source of a label from a button of the live view."""
REVIEW = "review"
"""Source of a label given afterwards. For this and the viewer's, the automatic label is the attempt's outcome."""
INSERT = "INSERT INTO labels (attempt_id, at, source, success, note) VALUES (?, ?, ?, ?, ?)"


def row(attempt_id: str, success: bool | None, source: str, note: str = "") -> tuple[object, ...]:
    """Values for `INSERT`."""
    at = datetime.now(UTC).isoformat(timespec="milliseconds")
    return attempt_id, at, source, None if success is None else int(success), note


def add_label(folder: Path, attempt_id: str, success: bool | None, source: str = REVIEW, note: str = "") -> None:
    """Append a label to a run folder, also while a run writes to it (from a viewer, another thread or process).

    Args:
        folder: the run folder.
        attempt_id: which attempt.
        success: None for "cannot tell".
        source: `REVIEW` or `VIEWER`.
        note: anything.

    Raises:
        BadInput: there is no such attempt, or the log cannot be written.
    """
    db = schema.open_to_write(folder)
    try:
        if db.execute("SELECT 1 FROM attempts WHERE attempt_id = ?", (attempt_id,)).fetchone() is None:
            raise BadInput(f"{folder} has no attempt '{attempt_id}'. See: evg-app trials export {folder}")
        db.execute(INSERT, row(attempt_id, success, source, note))
    except sqlite3.Error as error:
        raise BadInput(f"the label cannot be written to {folder}: {error}") from error
    finally:
        db.close()
