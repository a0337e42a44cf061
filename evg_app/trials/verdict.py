"""A comparison of two runs in numbers and in words."""

from dataclasses import asdict
from typing import Any

from evg_app.trials import sequential
from evg_app.trials.compare import Counts, fisher, newcombe, paired_rounds_differ, rounds_differ, same_rounds
from evg_app.trials.rows import LogRows
from evg_app.trials.sample_size import to_separate
from evg_app.trials.statistics import rate, wilson

LEVEL = 0.05
"""Below this p a difference is called one."""


def compare(a: LogRows, b: LogRows) -> dict[str, Any]:
    """GSR and DR of two runs: rates, difference with interval, exact and sequential tests, trials still needed."""
    counts = {"gsr": (a.gsr_counts, b.gsr_counts)}
    objects = a.dr_counts, b.dr_counts
    if objects[0] is not None and objects[1] is not None:
        counts["dr"] = objects[0], objects[1]
    facts: dict[str, Any] = {name: _tests(*pair) for name, pair in counts.items()}
    facts["gsr"]["sequential_attempts"] = _sequential(sequential.attempts_differ(a.outcomes(), b.outcomes()))
    return {"a": _who(a), "b": _who(b), **facts}


def _who(rows: LogRows) -> dict[str, Any]:
    """Which run it is."""
    first = rows.runs[0]
    return {"run_dir": str(rows.folder), "model": first["model"], "weights_sha256": first["weights_sha256"]}


def _tests(a: Counts, b: Counts) -> dict[str, Any]:
    """Rates, difference and tests of one measure."""
    facts: dict[str, Any] = {
        "a": [a.k, a.n, *wilson(a.k, a.n)],
        "b": [b.k, b.n, *wilson(b.k, b.n)],
        "same_rounds": same_rounds(a, b),
    }
    if not (a.n and b.n):
        return facts
    p1, p2 = a.k / a.n, b.k / b.n
    facts |= {
        "difference": p1 - p2,
        "difference_ci": list(newcombe(a.k, a.n, b.k, b.n)),
        "fisher_p": fisher(a.k, a.n, b.k, b.n),
        "rounds_p": paired_rounds_differ(a, b) if same_rounds(a, b) else rounds_differ(a, b),
        "trials_needed_each": to_separate(p1, p2),
    }
    if same_rounds(a, b):
        facts["sequential_rounds"] = _sequential(sequential.rounds_differ(*_round_rates(a, b)))
    return facts


def _round_rates(a: Counts, b: Counts) -> tuple[list[float], list[float]]:
    """Rates of the rounds that both runs tried, in the order of the first."""
    other = {name: (k, n) for name, k, n in zip(b.rounds, b.successes, b.trials, strict=True)}
    pairs = [
        (k / n, other[name][0] / other[name][1])
        for name, k, n in zip(a.rounds, a.successes, a.trials, strict=True)
        if n and other[name][1]
    ]
    return [x for x, _ in pairs], [y for _, y in pairs]


def _sequential(found: sequential.Sequential) -> dict[str, Any]:
    """A sequential test as JSON."""
    facts = asdict(found)
    return {"steps": len(facts.pop("e")), "e_now": found.e[-1] if found.e else 1.0, **facts}


def lines(facts: dict[str, Any]) -> list[str]:
    """The comparison for a terminal."""
    out = [f"{x}: {facts[x]['run_dir']}  {facts[x]['model']} {facts[x]['weights_sha256'][:12]}" for x in "ab"]
    for name in ("gsr", "dr"):
        if name in facts:
            out += ["", *_test_lines(name.upper(), facts[name])]
    return out


def _test_lines(name: str, f: dict[str, Any]) -> list[str]:
    """One measure for a terminal."""
    out = [f"{name}  a {rate(*f['a'][:2])}   b {rate(*f['b'][:2])}"]
    if "difference" not in f:
        return [*out, "     nothing to compare: one run has no trial"]
    low, high = f["difference_ci"]
    paired = "paired by round" if f["same_rounds"] else "rounds as units"
    out += [
        f"     a - b {100 * f['difference']:+.1f} points [{100 * low:+.1f}, {100 * high:+.1f}] (Newcombe)",
        f"     p = {f['fisher_p']:.3g} Fisher, attempts independent; p = {f['rounds_p']:.3g} permutation, {paired}",
    ]
    for key, words in (("sequential_attempts", "attempts"), ("sequential_rounds", "rounds")):
        if key in f:
            out.append(_sequential_line(f[key], words))
    return [*out, f"     {_conclusion(f)}"]


def _sequential_line(s: dict[str, Any], words: str) -> str:
    """A sequential test for a terminal."""
    decided = (
        f"decided at {words[:-1]} {s['decided_at']}" if s["decided_at"] else "not decided: one may go on and look again"
    )
    return f"     sequential by {words}: E = {s['e_now']:.2f} after {s['steps']}, p = {s['p']:.3g}, {decided}"


def _conclusion(f: dict[str, Any]) -> str:
    """What it comes to, in one sentence."""
    p = f["rounds_p"]
    if p < LEVEL:
        return "rounds as units, the difference is real at 5 %"
    needed = f["trials_needed_each"]
    if needed is None:
        return "nothing tells them apart"
    more = [max(needed - f[x][1], 0) for x in "ab"]
    return (
        f"not told apart; if the rates are as seen, {needed} trials each give 80 % power "
        f"({more[0]} more of a, {more[1]} more of b)"
    )
