"""What a study says in numbers: errors against their bounds, plain solvers beside them, bad sessions by cause."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from evg_app.benchmark.calibration.units import BAD, GOOD_MM, SessionRow
from evg_app.config.calibration import MODES
from evg_app.trials.statistics import wilson


def summary(rows: list[SessionRow]) -> dict[str, Any]:
    """Everything, by mode and by kind. JSON."""
    good = {mode: [r for r in rows if r.kind == "good" and r.mode == mode] for mode in MODES}
    bad = [r for r in rows if r.kind != "good"]
    return {
        "good": {mode: _good(found) for mode, found in good.items() if found},
        "bad": {kind: _bad([r for r in bad if r.kind == kind]) for kind in BAD if any(r.kind == kind for r in bad)},
        "bad_all": _bad(bad) if bad else None,
    }


def share(flags: Iterable[bool]) -> dict[str, Any]:
    """k of n with its 95 % Wilson interval."""
    found = list(flags)
    low, high = wilson(sum(found), len(found))
    return {"k": sum(found), "n": len(found), "ci": [round(low, 4), round(high, 4)]}


def spread(values: Iterable[float | None]) -> dict[str, Any]:
    """Median, 95th percentile and largest of those that are not None, and how many those are."""
    found = np.array([v for v in values if v is not None], dtype=np.float64)
    if not len(found):
        return {"n": 0, "median": None, "p95": None, "max": None}
    numbers = {"median": np.median(found), "p95": np.percentile(found, 95), "max": found.max()}
    return {"n": len(found), **{name: round(float(v), 4) for name, v in numbers.items()}}


def _good(rows: list[SessionRow]) -> dict[str, Any]:
    """What the good sessions of one mode say."""
    solved = [r for r in rows if r.facts["true_mm"] is not None]
    facts = [r.facts for r in solved]
    return {
        "sessions": len(rows),
        "verdicts": {v: sum(r.facts["verdict"] == v for r in rows) for v in ("go", "warn", "refuse")},
        "true_mm": spread(f["true_mm"] for f in facts),
        "true_deg": spread(f["true_deg"] for f in facts),
        "bound_mm": spread(f["bound_mm"] for f in facts),
        "heldout_mm": spread(f["heldout_mm"] for f in facts),
        "heldout_deg": spread(f["heldout_deg"] for f in facts),
        "reprojection_px": spread(f["reprojection_px"] for f in facts),
        "samples": spread(float(f["samples"]) for f in facts),
        "true_below_bound": share(f["true_mm"] <= f["bound_mm"] for f in facts),
        "plain": {name: _plain(rows, name) for name in rows[0].plain_mm},
    }


def _plain(rows: list[SessionRow], name: str) -> dict[str, Any]:
    """What one plain solver made of the same sessions."""
    return {
        "failed": sum(r.plain_mm.get(name) is None for r in rows),
        "true_mm": spread(r.plain_mm.get(name) for r in rows),
        "true_deg": spread(r.plain_deg.get(name) for r in rows),
    }


def _bad(rows: list[SessionRow]) -> dict[str, Any]:
    """What was done with deliberately bad sessions."""
    true = [r.facts["true_mm"] for r in rows]
    passed = [r for r in rows if not r.harmless]
    return {
        "sessions": len(rows),
        "named_and_harmless": share(r.named and r.harmless for r in rows),
        "named": share(r.named for r in rows),
        "refused": sum(r.facts["verdict"] == "refuse" for r in rows),
        "repaired": sum(r.facts["verdict"] != "refuse" and r.harmless for r in rows),
        f"let_through_above_{GOOD_MM:g}_mm": len(passed),
        "true_mm": spread(true),
        "best_plain_mm": spread(_best_plain(r) for r in rows),
    }


def _best_plain(row: SessionRow) -> float | None:
    """True error of the plain solver that happened to be best [mm]."""
    known = [v for name, v in row.plain_mm.items() if v is not None and not name.startswith("three")]
    return min(known, default=None)
