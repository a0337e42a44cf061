"""A run folder in one dictionary: the run's JSON."""

import json
import sqlite3
from collections import defaultdict
from pathlib import Path
from typing import Any

from evg_app.events import COMPUTE_STAGES, StopReason
from evg_app.trials import schema
from evg_app.trials.bootstrap import cluster_bootstrap
from evg_app.trials.reasons import reason, tree
from evg_app.trials.rounds import design_effect, round_interval
from evg_app.trials.rows import LogRows, key, read_rows
from evg_app.trials.sample_size import for_half_width
from evg_app.trials.statistics import agreement, confusion, fraction, median_p95, picks_per_hour, tally, wilson

PRECISION = 0.05
"""Half width of the interval that "trials still needed" aims at."""


def summary(folder: Path) -> dict[str, Any]:
    """Everything `evg-app trials stats` and `--json` say about one run. Rates are fractions.

    Raises:
        BadInput: the folder holds no readable trial log.
    """
    return summarise(read_rows(folder))


def summarise(rows: LogRows) -> dict[str, Any]:
    """The same, from rows already read."""
    executed = [row for row in rows.passes if row["counts"]]
    return {
        **_rates(rows),
        **_times(rows),
        "operator": _operator(rows),
        "stop_reasons": tally(row["stop_reason"] or "interrupted" for row in rows.rounds),
        "outcomes": tally(row["outcome"] for row in rows.passes),
        "failure_reasons": tally(row["failure"] for row in executed),
        "reason_tree": tree(
            reason(row["outcome"], row["failure"] or "", rows.refused.get(row["attempt_id"], {})) for row in rows.passes
        ),
        "verdicts": dict(rows.verdicts),
        "no_feasible": _no_feasible(rows),
        "confusion": confusion([(bool(row["verified"]), bool(row["truth"])) for row in _judged(rows)]),
        "round_rows": _rounds(rows),
        **_origin(rows),
        "run_dir": str(rows.folder),
    }


def _rates(rows: LogRows) -> dict[str, Any]:
    """GSR and DR with their intervals, and the counts they are made of."""
    gsr, dr = rows.gsr_counts, rows.dr_counts
    k, n = gsr.k, gsr.n
    likely = (k + 2) / (n + 4)  # Agresti and Coull's centre: few trials without a failure do not promise a rate of 1
    needed = max(for_half_width(likely, PRECISION) - n, 0) if n else None
    return {
        "gsr": fraction(k, n),
        "gsr_ci": list(wilson(k, n)),
        "gsr_rounds_ci": _listed(round_interval(gsr.successes, gsr.trials)),
        "gsr_bootstrap_ci": _listed(cluster_bootstrap(gsr.successes, gsr.trials)),
        "design_effect": round(design_effect(gsr.successes, gsr.trials), 3),
        "attempts_still_needed_for_5_percent": needed,
        "dr": None if dr is None else fraction(dr.k, dr.n),
        "dr_ci": None if dr is None else list(wilson(dr.k, dr.n)),
        "dr_rounds_ci": None if dr is None else _listed(round_interval(dr.successes, dr.trials)),
        "dr_bootstrap_ci": None if dr is None else _listed(cluster_bootstrap(dr.successes, dr.trials)),
        "successes": k,
        "removed": None if dr is None else dr.k,
        "attempts": n,
        "passes": len(rows.passes),
        "objects": None if dr is None else dr.n,
        "rounds": len(rows.rounds),
        "rounds_begun_again": rows.superseded,
    }


def _no_feasible(rows: LogRows) -> dict[str, Any]:
    """Rounds that ended "no feasible grasp" although the planner had some, of the rounds in which it had some."""
    had = {key(row) for row in rows.passes if row["candidates"]}
    ended = [row for row in rows.rounds if key(row) in had and row["stop_reason"] == StopReason.NO_FEASIBLE]
    return {"rounds": len(ended), "of": len(had), "ci": list(wilson(len(ended), len(had)))}


def _listed(interval: tuple[float, float] | None) -> list[float] | None:
    """An interval as JSON."""
    return None if interval is None else list(interval)


def _times(rows: LogRows) -> dict[str, Any]:
    """Motion and computing, by stage."""
    motion_s = sum(row["motion_s"] for row in rows.passes)
    compute_s = sum(row["compute_ms"] for row in rows.passes) / 1e3
    ready = {row["attempt_id"]: 0.0 for row in rows.passes if row["chosen"] is not None}
    walls: dict[str, list[float]] = defaultdict(list)
    computing = {stage.value for stage in COMPUTE_STAGES}
    for attempt_id, stage, wall_ms in rows.stages:
        walls[stage].append(wall_ms)
        if stage in computing and attempt_id in ready:
            ready[attempt_id] += wall_ms
    return {
        "picks_per_hour": round(picks_per_hour(rows.gsr_counts.k, motion_s, compute_s), 2),
        "motion_s": round(motion_s, 3),
        "compute_s": round(compute_s, 3),
        "stage_ms": {name: median_p95(values) for name, values in walls.items()},
        "compute_ms": median_p95(ready.values()),
    }


def _operator(rows: LogRows) -> dict[str, Any] | None:
    """The operator's labels beside the automatic ones; None when nobody labelled."""
    executed = [row for row in rows.passes if row["counts"] and row["attempt_id"] in rows.labels]
    if not executed:
        return None
    said = [(row, rows.labels[row["attempt_id"]].success) for row in executed]
    pairs = [(rows.automatic_success(row), success) for row, success in said if success is not None]
    automatic = [rows.automatic_success(row) for row in rows.passes if row["counts"]]
    k, n = sum(automatic), len(automatic)
    return {
        "labelled": len(executed),
        "cannot_tell": len(executed) - len(pairs),
        **agreement(pairs),
        "disagreeing_attempts": [r["attempt_id"] for r, s in said if s is not None and s != rows.automatic_success(r)],
        "gsr_automatic": fraction(k, n),
        "gsr_automatic_counts": [k, n],
        "gsr_automatic_ci": list(wilson(k, n)),
    }


def _judged(rows: LogRows) -> list[sqlite3.Row]:
    """Attempts on which both verify and the referee have an opinion."""
    return [r for r in rows.passes if r["counts"] and r["verified"] is not None and r["truth"] is not None]


def _rounds(rows: LogRows) -> list[dict[str, Any]]:
    """One row for each round."""
    passes = rows.by_round
    return [
        {
            "seed": row["seed"],
            "round": row["round_index"],
            "objects": row["objects"],
            "attempts": sum(p["counts"] for p in passes[key(row)]),
            "successes": sum(rows.success(p) for p in passes[key(row)] if p["counts"]),
            "stop_reason": row["stop_reason"] or "interrupted",
            "detail": row["detail"] or "",
        }
        for row in rows.rounds
    ]


def _origin(rows: LogRows) -> dict[str, Any]:
    """What was run: model, hashes, session, seeds."""
    first, last = rows.runs[0], rows.runs[-1]
    facts, seeds = json.loads(first["provenance"]), json.loads(first["seeds"])
    return {
        "seed": seeds[0] if len(seeds) == 1 else seeds,
        "model": first["model"],
        "weights_sha256": first["weights_sha256"],
        "git_commit": facts.get("git_commit", "unknown"),
        "config_sha256": first["config_sha256"],
        "protocol": first["protocol"],
        "sessions": len(rows.runs),
        "status": last["status"] or "interrupted",
        "status_detail": last["detail"] or "",
        "run_id": first["run_id"],
        "started_at": first["started_at"],
        "schema_version": schema.SCHEMA_VERSION,
    }
