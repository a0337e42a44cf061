"""Quantiles of Student's t without SciPy, whose import takes longer than all statistics of a log."""

import math
from functools import lru_cache


@lru_cache(maxsize=64)
def t_quantile(p: float, freedom: int) -> float:
    """The t that P(T <= t) = p, for p in [0.5, 1) and whole degrees of freedom from 1; by bisection, to 1e-10."""
    low, high = 0.0, 1.0
    while t_probability(high, freedom) < p:
        low, high = high, 2.0 * high
    while high - low > 1e-10 * max(high, 1.0):
        middle = (low + high) / 2
        low, high = (middle, high) if t_probability(middle, freedom) < p else (low, middle)
    return (low + high) / 2


def t_probability(t: float, freedom: int) -> float:
    """P(T <= t) for t >= 0: the finite sums of Abramowitz and Stegun 26.7.3 and 26.7.4."""
    angle = math.atan2(t, math.sqrt(freedom))
    sine, cosine2 = math.sin(angle), math.cos(angle) ** 2
    odd = freedom % 2
    term = math.cos(angle) if odd else 1.0
    total = term if freedom > 1 else 0.0
    for k in range(3 if odd else 2, freedom - 1, 2):
        term *= cosine2 * (k - 1) / k
        total += term
    inside = 2 / math.pi * (angle + sine * total) if odd else sine * total
    return 0.5 + inside / 2
