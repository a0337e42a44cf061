"""Export: tables as CSV for statistics programs, attempts as MCAP for Foxglove."""

import csv
import io
import sqlite3
from pathlib import Path

from evg_app.trials import schema
from evg_app.trials.arrays import write_atomically
from evg_app.trials.rows import read_rows

TABLES = ("runs", "rounds", "attempts", "stages", "verdicts", "labels")
"""Tables that are written as CSV as they are; the events stay in the database."""
JUDGED = ("attempt_id", "seed", "round_index", "attempt_index", "success", "automatic_success", "operator_label")
"""Columns of `attempts_judged.csv`."""


def export_csv(folder: Path, target: Path) -> list[Path]:
    """Write one CSV per table into `target`, and `attempts_judged.csv`: one row an attempt with its final label.

    Raises:
        BadInput: the folder holds no readable trial log.
        OSError: a file cannot be written.
    """
    rows = read_rows(folder)
    target.mkdir(parents=True, exist_ok=True)
    written = []
    db = schema.open_existing(folder)
    try:
        for table in TABLES:
            written.append(_write(target / f"{table}.csv", db.execute(f"SELECT * FROM {table} ORDER BY rowid")))
    finally:
        db.close()
    lines: list[tuple[object, ...]] = [
        ("attempt_id", "seed", "round_index", "attempt_index", "success", "automatic_success", "operator_label")
    ]
    for row in rows.passes:
        if row["counts"]:
            label = rows.labels.get(row["attempt_id"])
            said = "" if label is None else "unclear" if label.success is None else str(int(label.success))
            name = row["attempt_id"], row["seed"], row["round_index"], row["attempt_index"]
            judged = str(int(rows.success(row))), str(int(rows.automatic_success(row))), said
            lines.append((*name, *judged))
    return [*written, _csv(target / "attempts_judged.csv", lines)]


def _write(path: Path, cursor: sqlite3.Cursor) -> Path:
    """What a query found, with its column names."""
    return _csv(path, [tuple(column[0] for column in cursor.description), *map(tuple, cursor)])


def _csv(path: Path, lines: list[tuple[object, ...]]) -> Path:
    """Rows as a CSV file, whole or not at all."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    write_atomically(path, text.getvalue().encode("utf-8"))
    return path
