"""Rounds, not attempts, are the units: attempts of one round share a scene, and often go the same way."""

from collections.abc import Sequence

import numpy as np

from evg_app.trials.statistics import wilson
from evg_app.trials.student import t_quantile


def design_effect(successes: Sequence[int], trials: Sequence[int]) -> float:
    """Variance of the rate with rounds as units over that of independent attempts; 1 when it cannot be told.

    Above 1, attempts of a round go the same way and Wilson's interval is too short (Kish 1965, linearised ratio).
    """
    s, n = np.asarray(successes, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    s, n = s[n > 0], n[n > 0]
    total, rounds = n.sum(), len(n)
    p = s.sum() / total if total else 0.0
    if rounds < 2 or not 0.0 < p < 1.0:
        return 1.0
    by_round = rounds / (rounds - 1) * float(((s - p * n) ** 2).sum()) / total**2
    return float(by_round / (p * (1 - p) / total)) or 1.0


def round_interval(successes: Sequence[int], trials: Sequence[int], level: float = 0.95) -> tuple[float, float] | None:
    """Interval of sum(successes) / sum(trials), rounds being the units. None with fewer than two rounds.

    Wilson's interval with the trials divided by the design effect, and with the quantile of Student's t of one degree
    of freedom less than rounds (Franco, Little, Louis and Slud 2019; Dean and Pagano 2015). docs/trials.md has its
    coverage.

    Args:
        successes, trials: per round.
        level: of confidence.
    """
    tried = [(k, n) for k, n in zip(successes, trials, strict=True) if n]
    if len(tried) < 2:
        return None
    effect, quantile = design_effect(successes, trials), t_quantile(0.5 + level / 2, len(tried) - 1)
    return wilson(sum(k for k, _ in tried) / effect, sum(n for _, n in tried) / effect, quantile)
