"""A summary as text for a terminal."""

from collections.abc import Mapping
from typing import Any

from evg_app.trials.reasons import tree_lines
from evg_app.trials.statistics import rate
from evg_app.types import Verdict


def report(facts: Mapping[str, Any]) -> str:
    """Lines about one run, from `summary`. Every rate comes with its counts and 95 % interval."""
    return "\n".join([*_head(facts), "", *_results(facts), "", *_reasons(facts), "", *_times(facts)])


def _head(facts: Mapping[str, Any]) -> list[str]:
    """Which run it was."""
    weights = facts["weights_sha256"][:12] or "none"
    seeds = facts["seed"]
    return [
        f"run     {facts['run_dir']}  ({facts['started_at']}, {facts['status']})",
        f"model   {facts['model']}  weights {weights}  commit {facts['git_commit'][:12]}  seed {seeds}",
    ]


def _results(facts: Mapping[str, Any]) -> list[str]:
    """Rates, intervals, picks per hour."""
    cleared = rate(facts["removed"], facts["objects"]) if facts["objects"] is not None else "unknown (no object count)"
    lines = [
        f"GSR     {rate(facts['successes'], facts['attempts'])}   grasps that ended in the bin, of those executed",
        f"DR      {cleared}   objects removed, of those on the table",
        f"rounds  {facts['rounds']}   picks per hour {facts['picks_per_hour']:.0f}"
        f"   (motion {facts['motion_s']:.1f} s, computing {facts['compute_s']:.1f} s)",
    ]
    if facts["gsr_rounds_ci"] is not None:
        lines.append(f"        {by_rounds(facts)}")
    if facts["attempts_still_needed_for_5_percent"]:
        more = facts["attempts_still_needed_for_5_percent"]
        lines.append(f"        {more} more attempts for an interval of +/- 5 points")
    rejected = facts["verdicts"].get(str(Verdict.REJECTED), 0)
    if rejected:
        lines.append(f"        a person rejected {rejected} grasps: these are rates of planner and person together")
    if facts["rounds_begun_again"]:
        lines.append(f"        {facts['rounds_begun_again']} interrupted rounds were begun again and do not count")
    return lines + _operator(facts["operator"])


def by_rounds(facts: Mapping[str, Any]) -> str:
    """The intervals of GSR whose units are rounds."""
    (low, high), (b_low, b_high) = ([100 * end for end in facts[f"gsr_{name}_ci"]] for name in ("rounds", "bootstrap"))
    return (
        f"rounds as units, GSR [{low:.1f}, {high:.1f}] % (design effect {facts['design_effect']:.2f}; "
        f"cluster bootstrap [{b_low:.1f}, {b_high:.1f}])"
    )


def _operator(facts: Mapping[str, Any] | None) -> list[str]:
    """How the operator agrees with the automatic label."""
    if facts is None:
        return []
    k, n = facts["gsr_automatic_counts"]
    kappa = "" if facts["kappa"] is None else f", kappa {facts['kappa']:.2f}"
    return [
        f"operator labelled {facts['labelled']} attempts; agrees with the automatic label in "
        f"{rate(facts['agree'], facts['compared'])}{kappa}",
        f"        automatic success only {facts['only_automatic_success']}, operator success only "
        f"{facts['only_operator_success']}, cannot tell {facts['cannot_tell']}",
        f"        GSR of the automatic label {rate(k, n)}",
    ]


def _reasons(facts: Mapping[str, Any]) -> list[str]:
    """Why rounds ended and passes failed."""
    table = facts["confusion"]
    return [
        f"rounds ended      {_counts(facts['stop_reasons'])}",
        f"no feasible grasp {rate(facts['no_feasible']['rounds'], facts['no_feasible']['of'])}"
        "   of the rounds in which the planner had grasps",
        f"failures          {_counts(facts['failure_reasons'])}",
        f"candidates        {_counts(facts['verdicts'])}",
        "verify vs truth   "
        f"held and in the bin {table['true_positive']}, held but not {table['false_positive']}, "
        f"empty but in the bin {table['false_negative']}, empty and not {table['true_negative']}",
        "passes without a success, by where they failed:",
        *(f"    {line}" for line in tree_lines(facts["reason_tree"])),
    ]


def _times(facts: Mapping[str, Any]) -> list[str]:
    """Wall time by stage."""
    lines = [f"{'stage':<10}{'median ms':>11}{'p95 ms':>11}"]
    for name, times in {**facts["stage_ms"], "compute": facts["compute_ms"]}.items():
        if times["median"] is not None:
            lines.append(f"{name:<10}{times['median']:>11.1f}{times['p95']:>11.1f}")
    return [*lines, "compute: from the depth image to the ready trajectory"]


def _counts(words: Mapping[str, int]) -> str:
    """Words with their counts, in one line."""
    return ", ".join(f"{word} {n}" for word, n in words.items()) or "none"
