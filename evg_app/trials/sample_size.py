"""How many trials are still needed."""

import math
from statistics import NormalDist

from evg_app.trials.statistics import Z_95, wilson

MOST = 1_000_000
"""More trials than anybody makes."""


def to_separate(p1: float, p2: float, power: float = 0.8, level: float = 0.95) -> int | None:
    """Trials of each of two groups so that a two-sided test of p1 = p2 succeeds with this power.

    None when the rates are equal or no number below `MOST` is enough. Normal approximation with the pooled variance
    under the null hypothesis (Fleiss, Levin and Paik 2003, eq. 4.14 without continuity correction).

    Raises:
        ValueError: a rate is not in [0, 1].
    """
    if not (0.0 <= p1 <= 1.0 and 0.0 <= p2 <= 1.0):
        raise ValueError(f"rates {p1} and {p2} must lie in [0, 1]")
    if p1 == p2:
        return None
    za, zb = NormalDist().inv_cdf(0.5 + level / 2), NormalDist().inv_cdf(power)
    mean = (p1 + p2) / 2
    null, own = math.sqrt(2 * mean * (1 - mean)), math.sqrt(p1 * (1 - p1) + p2 * (1 - p2))
    n = ((za * null + zb * own) / (p1 - p2)) ** 2
    return None if n > MOST else max(math.ceil(n), 1)


def for_half_width(p: float, half_width: float, z: float = Z_95) -> int:
    """Fewest trials at rate p whose Wilson interval is at most 2 * half_width long, at most `MOST`.

    Raises:
        ValueError: p is not in [0, 1] or half_width not in (0, 0.5).
    """
    if not (0.0 <= p <= 1.0 and 0.0 < half_width < 0.5):
        raise ValueError(f"rate {p} must lie in [0, 1] and half width {half_width} in (0, 0.5)")
    low, high = 1, MOST
    while low < high:
        middle = (low + high) // 2
        ends = wilson(round(p * middle), middle, z)
        low, high = (low, middle) if ends[1] - ends[0] <= 2 * half_width else (middle + 1, high)
    return low
