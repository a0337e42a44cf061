"""Rates that say how sure they are, and everything else a run's log says in numbers."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

Z_95 = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""


def wilson(k: float, n: float, z: float = Z_95) -> tuple[float, float]:
    """Wilson score interval of a proportion k/n; (0, 1) when nothing was tried. Effective numbers need not be whole.

    Raises:
        ValueError: k is not in 0..n.
    """
    if not 0 <= k <= n:
        raise ValueError(f"{k} successes in {n} trials is impossible")
    if n == 0:
        return 0.0, 1.0
    p, z2 = k / n, z * z
    centre = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = z / (1 + z2 / n) * float(np.sqrt(p * (1 - p) / n + z2 / (4 * n * n)))
    low = 0.0 if k == 0 else max(centre - half, 0.0)
    high = 1.0 if k == n else min(centre + half, 1.0)
    return low, high


def rate(k: int, n: int) -> str:
    """`k/n = xx.x % [lo, hi]`, the interval in percent (Wilson, 95 %)."""
    if n == 0:
        return f"{k}/{n} = no trial"
    low, high = wilson(k, n)
    return f"{k}/{n} = {100 * k / n:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def fraction(k: int, n: int) -> float:
    """k/n, 0 when nothing was tried (spec §6.1)."""
    return k / n if n else 0.0


def median_p95(values: Iterable[float]) -> dict[str, float | None]:
    """Median and 95th percentile; None without values."""
    array = np.asarray(list(values), dtype=np.float64)
    if not len(array):
        return {"median": None, "p95": None}
    return {"median": round(float(np.median(array)), 3), "p95": round(float(np.percentile(array, 95)), 3)}


def picks_per_hour(successes: int, motion_s: float, compute_s: float) -> float:
    """Successes per hour of motion (on the clock) plus measured computing (wall)."""
    spent = motion_s + compute_s
    return 3600.0 * successes / spent if spent > 0 else 0.0


def confusion(judged: Sequence[tuple[bool, bool]]) -> dict[str, int]:
    """Counts of (verify, truth): does what verify says hold in the bin?"""
    names = {
        (True, True): "true_positive",
        (True, False): "false_positive",
        (False, True): "false_negative",
        (False, False): "true_negative",
    }
    counts = dict.fromkeys(names.values(), 0)
    for pair in judged:
        counts[names[pair]] += 1
    return counts


def agreement(pairs: Sequence[tuple[bool, bool]]) -> dict[str, Any]:
    """How an automatic label and a person's agree: counts, and Cohen's kappa (None when either never varies)."""
    n, both = len(pairs), sum(a == b for a, b in pairs)
    kappa = None
    if n:
        a, b = sum(x for x, _ in pairs) / n, sum(y for _, y in pairs) / n
        chance = a * b + (1 - a) * (1 - b)
        kappa = None if chance == 1.0 else (both / n - chance) / (1 - chance)
    return {
        "compared": n,
        "agree": both,
        "only_automatic_success": sum(x and not y for x, y in pairs),
        "only_operator_success": sum(y and not x for x, y in pairs),
        "kappa": kappa,
    }


def tally(words: Iterable[Any]) -> dict[str, int]:
    """How often each word occurs, most frequent first; empty words are left out."""
    counts: dict[str, int] = {}
    for word in words:
        if word:
            counts[str(word)] = counts.get(str(word), 0) + 1
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))
