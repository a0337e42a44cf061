"""A run folder in one dictionary: the run's JSON."""

import json
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evg_app.errors import BadInput
from evg_app.events import COMPUTE_STAGES
from evg_app.trials import schema
from evg_app.trials.statistics import confusion, fraction, median_p95, picks_per_hour, tally, wilson

Rows = Sequence[sqlite3.Row]


def summary(folder: Path) -> dict[str, Any]:
    """Everything `evg-app trials stats` and `--json` say about one run. Rates are fractions.

    Raises:
        BadInput: the folder holds no readable trial log.
    """
    db = schema.open_existing(folder)
    try:
        runs = db.execute("SELECT * FROM runs").fetchall()
        rounds = db.execute("SELECT * FROM rounds ORDER BY rowid").fetchall()
        passes = db.execute("SELECT * FROM attempts WHERE outcome IS NOT NULL ORDER BY rowid").fetchall()
        stages = db.execute("SELECT attempt_id, stage, wall_ms FROM stages ORDER BY rowid").fetchall()
        verdicts = db.execute("SELECT verdict, SUM(candidates) FROM verdicts GROUP BY verdict").fetchall()
    except sqlite3.Error as error:
        raise BadInput(f"{folder / schema.DATABASE} cannot be read: {error}") from error
    finally:
        db.close()
    if not runs:
        raise BadInput(f"{folder} holds a trial log without a run: it was interrupted while starting")
    run = runs[0]
    return {
        **_rates(rounds, passes),
        **_times(passes, stages),
        "stop_reasons": tally(row["stop_reason"] or "interrupted" for row in rounds),
        "outcomes": tally(row["outcome"] for row in passes),
        "failure_reasons": tally(row["failure"] for row in passes if row["counts"]),
        "verdicts": {row[0]: row[1] for row in sorted(verdicts, key=lambda row: (-row[1], row[0]))},
        "confusion": confusion([(bool(row["verified"]), bool(row["truth"])) for row in _judged(passes)]),
        "round_rows": [_round(row, passes) for row in rounds],
        **_origin(run),
        "run_dir": str(folder),
    }


def _rates(rounds: Rows, passes: Rows) -> dict[str, Any]:
    attempts = sum(row["counts"] for row in passes)
    successes = sum(row["outcome"] == "success" for row in passes)
    known = bool(rounds) and all(row["objects"] is not None for row in rounds)
    objects = sum(row["objects"] for row in rounds) if known else None
    cleared = None if objects is None else min(successes, objects)
    return {
        "gsr": fraction(successes, attempts),
        "gsr_ci": list(wilson(successes, attempts)),
        "dr": None if objects is None or cleared is None else fraction(cleared, objects),
        "dr_ci": None if objects is None or cleared is None else list(wilson(cleared, objects)),
        "successes": successes,
        "attempts": attempts,
        "passes": len(passes),
        "objects": objects,
        "rounds": len(rounds),
    }


def _times(passes: Rows, stages: Rows) -> dict[str, Any]:
    motion_s = sum(row["motion_s"] for row in passes)
    compute_s = sum(row["compute_ms"] for row in passes) / 1e3
    successes = sum(row["outcome"] == "success" for row in passes)
    names = list(dict.fromkeys(row["stage"] for row in stages))
    return {
        "picks_per_hour": round(picks_per_hour(successes, motion_s, compute_s), 2),
        "motion_s": round(motion_s, 3),
        "compute_s": round(compute_s, 3),
        "stage_ms": {name: median_p95(r["wall_ms"] for r in stages if r["stage"] == name) for name in names},
        "compute_ms": median_p95(_ready(passes, stages)),
    }


def _ready(passes: Rows, stages: Rows) -> list[float]:
    """Wall time [ms] from depth image to ready trajectory, of each pass that got one."""
    ready = {row["attempt_id"]: 0.0 for row in passes if row["chosen"] is not None}
    for row in stages:
        if row["attempt_id"] in ready and row["stage"] in [stage.value for stage in COMPUTE_STAGES]:
            ready[row["attempt_id"]] += row["wall_ms"]
    return list(ready.values())


def _judged(passes: Rows) -> list[sqlite3.Row]:
    """Attempts on which both verify and the referee have an opinion."""
    return [row for row in passes if row["counts"] and row["verified"] is not None and row["truth"] is not None]


def _round(row: sqlite3.Row, passes: Rows) -> dict[str, Any]:
    mine = [p for p in passes if (p["seed"], p["round_index"]) == (row["seed"], row["round_index"])]
    return {
        "seed": row["seed"],
        "round": row["round_index"],
        "objects": row["objects"],
        "attempts": sum(p["counts"] for p in mine),
        "successes": sum(p["outcome"] == "success" for p in mine),
        "stop_reason": row["stop_reason"] or "interrupted",
        "detail": row["detail"] or "",
    }


def _origin(run: sqlite3.Row) -> dict[str, Any]:
    facts, seeds = json.loads(run["provenance"]), json.loads(run["seeds"])
    return {
        "seed": seeds[0] if len(seeds) == 1 else seeds,
        "model": run["model"],
        "weights_sha256": run["weights_sha256"],
        "git_commit": facts.get("git_commit", "unknown"),
        "config_sha256": run["config_sha256"],
        "status": run["status"] or "interrupted",
        "status_detail": run["detail"] or "",
        "run_id": run["run_id"],
        "started_at": run["started_at"],
        "schema_version": schema.SCHEMA_VERSION,
    }
