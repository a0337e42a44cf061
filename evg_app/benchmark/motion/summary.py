"""Scenes to the benchmark's numbers: counts with intervals, times, what was touched."""

import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from evg_app.benchmark.motion.row import BASELINE, OBSERVED, TIMES, TRUE, Cycle, SceneRow, Target
from evg_app.trials.statistics import tally, wilson


def summary(rows: Sequence[SceneRow], policy: str, policies: Sequence[str], changed_area: float) -> dict[str, Any]:
    """The numbers of the JSON.

    Args:
        rows: the scenes.
        policy: the configured one for unknown space, to which the bare `*_observed` keys belong.
        policies: all of them.
        changed_area: from which changed area on the scene would be planned on anew [m^2].
    """
    targets = [target for row in rows for target in row.targets]
    cycles = [cycle for row in rows for cycle in row.cycles]
    arms = {arm: arm_facts(c for c in cycles if c.arm == arm) for arm in _arms(policies)}
    true, observed = arms[TRUE], arms[f"{OBSERVED} {policy}"]
    return {
        **reach_facts(targets),
        **{f"{name}_median": _percentile(_all(rows, name), 50) for name in TIMES},
        **{f"{name}_p99": _percentile(_all(rows, name), 99) for name in TIMES},
        "executed": true["executed"],
        "contacts": true["contacts"],
        "contacts_ci": true["contacts_ci"],
        "executed_observed": observed["executed"],
        "contacts_observed": observed["contacts"],
        "contacts_observed_ci": observed["contacts_ci"],
        "limit_violations": sum(arms[arm]["limit_violations"] for arm in arms if arm != BASELINE),
        "recheck": recheck_facts(cycles, changed_area),
        "unknown_space": policy,
        "arms": arms,
        "scenes": len(rows),
        "scenes_by_kind": tally(row.kind for row in rows),
        "by_kind": {kind: _of_kind(rows, kind, policies) for kind in sorted({row.kind for row in rows})},
    }


def reach_facts(targets: Sequence[Target]) -> dict[str, Any]:
    """Of the targets with a complete answer (`Target.legs`), how many the planner finds, and picks, and why not."""
    total = [t for t in targets if t.legs]
    found, picked = sum(t.found for t in total), sum(t.picked for t in total)
    return {
        "reachable_found": found,
        "reachable_total": len(total),
        "reachable_ci": list(wilson(found, len(total))),
        "reachable_picked": picked,
        "reachable_picked_ci": list(wilson(picked, len(total))),
        "reachable_not_picked": tally(t.verdict for t in total if not t.picked),
        "reach_targets": len(targets),
        "reach_configuration_total": sum(t.configuration for t in targets),
    }


def arm_facts(cycles: Iterable[Cycle]) -> dict[str, Any]:
    """Counts of one arm of the experiment."""
    asked = list(cycles)
    done = [c for c in asked if c.executed]
    touched = [c for c in done if c.contacts]
    broken = [c for c in done if c.broken]
    return {
        "asked": len(asked),
        "executed": len(done),
        "contacts": len(touched),
        "contacts_ci": list(wilson(len(touched), len(done))),
        "touched": tally(_pair(words) for c in touched for words in c.contacts),
        "limit_violations": len(broken),
        "broken": tally(name for c in broken for name in c.broken),
        "worst_ratios": _worst(done),
        "contacts_after": sum(bool(c.after) for c in done),
        "touched_after": tally(_pair(words) for c in done for words in c.after),
        "target_touched_before": sum(c.target_before for c in done),
        "held": sum(c.held for c in done),
        "delivered": sum(c.delivered for c in done),
        "ended": tally(re.sub(r"[\d.]+", "#", c.ended) if c.executed else "no pick" for c in asked),
        "no_pick": tally(_reasons(c.ended) for c in asked if not c.executed),
    }


def recheck_facts(cycles: Sequence[Cycle], changed_area: float) -> dict[str, Any]:
    """How often the look before the approach would have planned anew with nothing moved, and with the target moved."""
    still = [c.still for c in cycles if c.still is not None]
    moved = [c.moved for c in cycles if c.moved is not None]
    false, noticed = sum(area > changed_area for area in still), sum(area > changed_area for area in moved)
    return {
        "looks": len(still),
        "false_alarms": false,
        "false_alarms_ci": list(wilson(false, len(still))),
        "noticed": noticed,
        "noticed_ci": list(wilson(noticed, len(moved))),
        "largest_still_area_m2": max(still, default=None),
        "moved_area_m2_p5": _percentile(moved, 5),
    }


def _arms(policies: Sequence[str]) -> tuple[str, ...]:
    """Names of all arms."""
    return (TRUE, BASELINE, *(f"{OBSERVED} {policy}" for policy in policies))


def _of_kind(rows: Sequence[SceneRow], kind: str, policies: Sequence[str]) -> dict[str, Any]:
    """The headline counts of one kind of scene."""
    mine = [row for row in rows if row.kind == kind]
    facts: dict[str, Any] = {arm: {"executed": 0, "contacts": 0} for arm in _arms(policies)}
    for cycle in (c for row in mine for c in row.cycles if c.executed):
        facts[cycle.arm]["executed"] += 1
        facts[cycle.arm]["contacts"] += bool(cycle.contacts)
    reach = reach_facts([t for row in mine for t in row.targets])
    return facts | {key: reach[key] for key in ("reachable_found", "reachable_picked", "reachable_total")}


def _worst(cycles: Sequence[Cycle]) -> dict[str, float]:
    """The largest share of each limit over all cycles."""
    worst: dict[str, float] = {}
    for cycle in cycles:
        for name, ratio in (cycle.ratios or {}).items():
            worst[name] = max(worst.get(name, 0.0), ratio)
    return worst


def _pair(words: str) -> str:
    """Phase, link and what was touched, without number and depth: "reach: panda_hand - mug_03"."""
    return re.sub(r" \([-\d.]+ mm\)$", "", re.sub(r"- \d+:", "- ", words))


def _reasons(ended: str) -> str:
    """The verdicts of a decision without a pick, without counts."""
    return re.sub(r" \d+", "", ended.removeprefix("no pick: "))


def _all(rows: Sequence[SceneRow], name: str) -> list[float]:
    """One kind of times of all scenes."""
    return [ms for row in rows for ms in getattr(row, name)]


def _percentile(values: Iterable[float], share: float) -> float | None:
    """A percentile, or None without values."""
    array = np.array(list(values))
    return round(float(np.percentile(array, share)), 6) if len(array) else None
