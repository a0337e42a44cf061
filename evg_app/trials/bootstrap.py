"""Intervals that respect rounds: attempts of one round share a scene, so whole rounds are drawn again."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from evg_app.trials.statistics import wilson

DRAWS = 10_000
"""Bootstrap samples, fewer with many rounds."""
NUMBERS = 2_000_000
"""At most this many rounds are drawn in all."""
SEED = 20260101
"""Of the draws: the same log gives the same interval."""


def cluster_bootstrap(
    successes: Sequence[int], trials: Sequence[int], level: float = 0.95, seed: int = SEED
) -> tuple[float, float] | None:
    """Interval of sum(successes) / sum(trials), rounds being the units. None with fewer than two rounds.

    Percentile bootstrap with the small-sample correction of Hesterberg (2015, "What Teachers Should Know About the
    Bootstrap", section 3.1): the quantiles are those of a t distribution widened by sqrt(n / (n - 1)). When all
    rounds went the same way nothing varies, and the interval is Wilson's.

    Args:
        successes, trials: per round.
        level: of confidence.
        seed: of the draws.
    """
    s, n = np.asarray(successes, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    s, n = s[n > 0], n[n > 0]
    if len(n) < 2:
        return None
    if np.ptp(s / n) == 0.0:
        k, total = int(s.sum()), int(n.sum())
        return wilson(k, total, float(norm.ppf(0.5 + level / 2))) if k in (0, total) else (k / total, k / total)
    rates = resampled_rates(s, n, seed)
    tail = float(norm.cdf(-np.sqrt(len(n) / (len(n) - 1)) * t.ppf(0.5 + level / 2, len(n) - 1)))
    low, high = np.quantile(rates, [tail, 1.0 - tail])
    return float(low), float(high)


def resampled_rates(s: NDArray[np.float64], n: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """Rates of runs made of rounds drawn with replacement. Shapes (R,), (R,) -> (B,)."""
    rounds = len(n)
    draws = int(np.clip(NUMBERS // rounds, 1000, DRAWS))
    index = np.random.default_rng(seed).integers(0, rounds, size=(draws, rounds), dtype=np.int32)
    return np.asarray(s[index].sum(axis=1) / n[index].sum(axis=1))


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
    return float(by_round / (p * (1 - p) / total))
