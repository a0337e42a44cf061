"""A summary as text for a terminal."""

from collections.abc import Mapping
from typing import Any

from evg_app.trials.statistics import rate


def report(facts: Mapping[str, Any]) -> str:
    """Lines about one run, from `summary`. Every rate comes with its counts and 95 % interval."""
    return "\n".join([*_head(facts), "", *_results(facts), "", *_reasons(facts), "", *_times(facts)])


def _head(facts: Mapping[str, Any]) -> list[str]:
    weights = facts["weights_sha256"][:12] or "none"
    seeds = facts["seed"]
    return [
        f"run     {facts['run_dir']}  ({facts['started_at']}, {facts['status']})",
        f"model   {facts['model']}  weights {weights}  commit {facts['git_commit'][:12]}  seed {seeds}",
    ]


def _results(facts: Mapping[str, Any]) -> list[str]:
    known = facts["objects"] is not None
    cleared = (
        rate(min(facts["successes"], facts["objects"]), facts["objects"]) if known else "unknown (no object count)"
    )
    return [
        f"GSR     {rate(facts['successes'], facts['attempts'])}   grasps that ended in the bin, of those executed",
        f"DR      {cleared}   objects removed, of those on the table",
        f"rounds  {facts['rounds']}   picks per hour {facts['picks_per_hour']:.0f}"
        f"   (motion {facts['motion_s']:.1f} s, computing {facts['compute_s']:.1f} s)",
    ]


def _reasons(facts: Mapping[str, Any]) -> list[str]:
    table = facts["confusion"]
    return [
        f"rounds ended      {_counts(facts['stop_reasons'])}",
        f"failures          {_counts(facts['failure_reasons'])}",
        f"candidates        {_counts(facts['verdicts'])}",
        "verify vs truth   "
        f"held and in the bin {table['true_positive']}, held but not {table['false_positive']}, "
        f"empty but in the bin {table['false_negative']}, empty and not {table['true_negative']}",
    ]


def _times(facts: Mapping[str, Any]) -> list[str]:
    lines = [f"{'stage':<10}{'median ms':>11}{'p95 ms':>11}"]
    for name, times in {**facts["stage_ms"], "compute": facts["compute_ms"]}.items():
        if times["median"] is not None:
            lines.append(f"{name:<10}{times['median']:>11.1f}{times['p95']:>11.1f}")
    return [*lines, "compute: from the depth image to the ready trajectory"]


def _counts(words: Mapping[str, int]) -> str:
    return ", ".join(f"{word} {n}" for word, n in words.items()) or "none"
