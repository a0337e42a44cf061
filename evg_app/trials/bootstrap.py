"""The cluster bootstrap: whole rounds are drawn again. `rounds.round_interval` covers better."""

from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from evg_app.trials.statistics import wilson
from evg_app.trials.student import t_quantile

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
        return wilson(k, total, NormalDist().inv_cdf(0.5 + level / 2)) if k in (0, total) else (k / total, k / total)
    rates = resampled_rates(s, n, seed)
    quantile = float(np.sqrt(len(n) / (len(n) - 1)) * t_quantile(0.5 + level / 2, len(n) - 1))
    tail = NormalDist().cdf(-quantile)
    low, high = np.quantile(rates, [tail, 1.0 - tail])
    return float(low), float(high)


def resampled_rates(s: NDArray[np.float64], n: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """Rates of runs made of rounds drawn with replacement. Shapes (R,), (R,) -> (B,)."""
    rounds = len(n)
    draws = int(np.clip(NUMBERS // rounds, 1000, DRAWS))
    index = np.random.default_rng(seed).integers(0, rounds, size=(draws, rounds), dtype=np.int32)
    return np.asarray(s[index].sum(axis=1) / n[index].sum(axis=1))
