"""Why passes failed, as a tree: where in the loop, then what."""

from collections.abc import Iterable, Mapping
from typing import Any

from evg_app.events import AttemptOutcome
from evg_app.types import Verdict

BRANCHES = ("perception", "planning", "reach", "collision", "slip", "drop", "hardware", "user", "other")
"""First level of the tree, in the order of the loop."""

_FAILURES = {
    "contact on approach": "collision",
    "nothing held after lift": "slip",
    "object still in its place": "slip",
    "lost in transit": "drop",
    "still in the hand": "drop",
    "not in the bin": "drop",
    "device error": "hardware",
    "motion aborted": "hardware",
}
_OUTCOMES = {
    AttemptOutcome.EMPTY_VIEW: "perception",
    AttemptOutcome.NO_GRASP: "planning",
    AttemptOutcome.ERROR: "hardware",
    AttemptOutcome.ABANDONED: "user",
    AttemptOutcome.REPLANNED: "perception",
}
_VERDICTS = {
    Verdict.OUT_OF_WORKSPACE: "planning",
    Verdict.WIDTH: "planning",
    Verdict.IK: "reach",
    Verdict.JOINT_LIMIT: "reach",
    Verdict.NO_PATH: "reach",
    Verdict.SELF_COLLISION: "collision",
    Verdict.GRIPPER_COLLISION: "collision",
    Verdict.ARM_COLLISION: "collision",
    Verdict.REJECTED: "user",
}


def reason(outcome: str, failure: str, verdicts: Mapping[str, int]) -> tuple[str, str] | None:
    """Branch and leaf of one pass; None for a success.

    A pass without a feasible grasp is put where most of its judged candidates failed.
    """
    if outcome == AttemptOutcome.SUCCESS:
        return None
    if outcome == AttemptOutcome.FAILURE:
        return _FAILURES.get(failure, "other"), failure or "unknown"
    if outcome == AttemptOutcome.NO_FEASIBLE:
        judged = {v: n for v, n in verdicts.items() if v not in (Verdict.NOT_EXAMINED, Verdict.ACCEPTED)}
        if not judged:
            return "planning", "no candidate was examined"
        most = max(judged, key=lambda verdict: (judged[verdict], verdict))
        return _branch_of(most), f"all candidates refused, most for: {most}"
    known = {str(o): branch for o, branch in _OUTCOMES.items()}
    return known.get(outcome, "other"), outcome


def _branch_of(verdict: str) -> str:
    """Where a refused candidate belongs."""
    return {str(v): branch for v, branch in _VERDICTS.items()}.get(verdict, "other")


def tree(reasons: Iterable[tuple[str, str] | None]) -> dict[str, dict[str, Any]]:
    """`{branch: {"n": count, "leaves": {leaf: count}}}`: branches as in the loop, leaves most frequent first."""
    counts: dict[str, dict[str, int]] = {}
    for found in reasons:
        if found is not None:
            leaves = counts.setdefault(found[0], {})
            leaves[found[1]] = leaves.get(found[1], 0) + 1
    return {
        branch: {
            "n": sum(counts[branch].values()),
            "leaves": dict(sorted(counts[branch].items(), key=lambda item: (-item[1], item[0]))),
        }
        for branch in BRANCHES
        if branch in counts
    }


def tree_lines(found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The tree for a terminal."""
    lines = []
    for branch, node in found.items():
        lines.append(f"{branch:<11}{node['n']:>5}")
        lines += [f"    {n:>4}  {leaf}" for leaf, n in node["leaves"].items()]
    return lines or ["none"]
