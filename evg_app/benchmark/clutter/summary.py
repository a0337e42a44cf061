"""Rounds to rates with intervals, and two benchmarks side by side (spec §6.1)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from evg_app.benchmark.clutter.rounds import RoundResult
from evg_app.errors import BadInput
from evg_app.geometry import Array
from evg_app.trials.statistics import fraction, tally, wilson

RESAMPLES = 10_000
"""Of every bootstrap over rounds."""
BOOTSTRAP_SEED = 0
"""So that the same rounds always give the same interval."""
INTERVAL = (2.5, 97.5)
"""Percentiles of a 95 % interval."""
COUNTS = ("successes", "attempts", "cleared", "objects")


def rates(rows: Sequence[RoundResult]) -> dict[str, Any]:
    """GSR and DR (fractions, pooled over rounds) with 95 % intervals: Wilson for GSR, bootstrap over rounds for DR."""
    total = {name: sum(getattr(row, name) for row in rows) for name in COUNTS}
    plan_ms = [ms for row in rows for ms in row.plan_ms]
    return {
        "gsr": fraction(total["successes"], total["attempts"]),
        "gsr_ci": list(wilson(total["successes"], total["attempts"])),
        "dr": fraction(total["successes"], total["objects"]),
        "dr_ci": _interval(_ratio(_resampled(rows, ("successes", "objects")))),
        **total,
        "rounds": len(rows),
        "plan_ms_median": round(float(np.median(plan_ms)), 2) if plan_ms else None,
        "ends": tally(row.end for row in rows),
        "outcomes": tally(outcome for row in rows for outcome in row.outcomes),
    }


def by_seed(rows: Sequence[RoundResult]) -> dict[str, Any]:
    """GSR and DR of each seed, in the order of the seeds: their mean and deviation is what papers print."""
    groups = [[row for row in rows if row.seed == seed] for seed in sorted({row.seed for row in rows})]
    return {
        "gsr_by_seed": [fraction(sum(r.successes for r in g), sum(r.attempts for r in g)) for g in groups],
        "dr_by_seed": [fraction(sum(r.successes for r in g), sum(r.objects for r in g)) for g in groups],
    }


def paired(a: Sequence[RoundResult], b: Sequence[RoundResult]) -> dict[str, Any]:
    """GSR and DR of both over the rounds they share, and b - a with 95 % bootstrap intervals over these rounds.

    Raises:
        BadInput: they share no round, or a shared round had other objects.
    """
    left, right = ({(row.seed, row.round): row for row in rows} for rows in (a, b))
    keys = sorted(left.keys() & right.keys())
    if not keys:
        raise BadInput("the two files share no (seed, round); run both with the same --seeds")
    for key in keys:
        if left[key].names != right[key].names:
            raise BadInput(
                f"round {key[1]} of seed {key[0]} holds other objects in the two files; use the same --objects"
            )
    answer: dict[str, Any] = {"rounds": len(keys)}
    for name, columns in (("gsr", ("successes", "attempts")), ("dr", ("successes", "objects"))):
        resampled = [_ratio(_resampled([rows[key] for key in keys], columns)) for rows in (left, right)]
        whole = [
            fraction(*(sum(getattr(rows[key], column) for key in keys) for column in columns)) for rows in (left, right)
        ]
        difference = whole[1] - whole[0]
        answer[name] = {"a": whole[0], "b": whole[1], "difference": difference}
        answer[name]["ci"] = _interval(resampled[1] - resampled[0])
    return answer


def _resampled(rows: Sequence[RoundResult], columns: tuple[str, str]) -> Array:
    """Sums of two columns over bootstrap samples of the rounds; the same samples for the same number of rounds."""
    table = np.array([[getattr(row, column) for column in columns] for row in rows], dtype=np.float64).reshape(-1, 2)
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    n = max(len(rows), 1)
    weights = rng.multinomial(n, np.full(n, 1.0 / n), size=RESAMPLES)
    sums: Array = weights[:, : len(table)] @ table
    return sums


def _ratio(sums: Array) -> Array:
    """First over second column, 0 where the second is 0."""
    ratio: Array = np.where(sums[:, 1] > 0, sums[:, 0] / np.maximum(sums[:, 1], 1.0), 0.0)
    return ratio


def _interval(values: Array) -> list[float]:
    """95 % percentile interval."""
    return [float(v) for v in np.percentile(values, INTERVAL)]
