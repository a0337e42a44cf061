"""Tests that one may look at after every attempt and stop when they are clear, without cheating.

Each is an e-process E: under the null hypothesis its expectation is at most 1 at any stopping time, so that
E >= 20 happens with probability at most 5 % however often one looks (Ville), and p = 1 / max E is valid at any time.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BETS = np.linspace(-0.9, 0.9, 37)
"""Fractions that the test on rounds bets; an even mixture of them is held."""
PRIOR = 0.18
"""Pseudo-counts of the rates in the test on attempts (Turner, Ly and Grünwald 2024, their recommended gamma)."""


@dataclass(frozen=True)
class Sequential:
    """A sequential test so far.

    Attributes:
        e: evidence after each step; above 1 speaks against the null hypothesis.
        p: anytime-valid p-value now.
        decided_at: first step (from 1) at which p was 0.05 or less, None so far.
    """

    e: tuple[float, ...]
    p: float
    decided_at: int | None


def attempts_differ(a: Sequence[bool], b: Sequence[bool]) -> Sequential:
    """Are two success rates different? One step takes the next attempt of each run; the longer tail waits.

    The e-variable for two Bernoulli streams of Turner, Ly and Grünwald (2024, "Generic E-variables for exact
    sequential k-sample tests that allow for optional stopping"), rates learned from the past. Attempts count as
    independent given the rate.
    """
    steps = min(len(a), len(b))
    ya, yb = np.asarray(a[:steps], dtype=np.float64), np.asarray(b[:steps], dtype=np.float64)
    seen = np.arange(steps)
    pa = (PRIOR + np.concatenate([[0.0], np.cumsum(ya)[:-1]])[:steps]) / (2 * PRIOR + seen)
    pb = (PRIOR + np.concatenate([[0.0], np.cumsum(yb)[:-1]])[:steps]) / (2 * PRIOR + seen)
    p0 = (pa + pb) / 2
    log_e = np.cumsum(
        _log_likelihood(pa, ya) + _log_likelihood(pb, yb) - _log_likelihood(p0, ya) - _log_likelihood(p0, yb)
    )
    return _sequential(np.exp(log_e))


def rounds_differ(a: Sequence[float], b: Sequence[float]) -> Sequential:
    """Is the mean of paired round rates in [0, 1] different? Nothing is assumed about attempts within a round.

    Capital of an even mixture of constant bets on the difference (Waudby-Smith and Ramdas 2024, "Estimating means of
    bounded random variables by betting"): E = mean over bets of prod(1 + bet * (a_i - b_i)).
    """
    steps = min(len(a), len(b))
    d = np.asarray(a[:steps], dtype=np.float64) - np.asarray(b[:steps], dtype=np.float64)
    wealth = np.exp(np.cumsum(np.log1p(BETS[:, None] * d[None]), axis=1)).mean(axis=0)
    return _sequential(wealth)


def rate_sequence(k: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Interval of a rate that is right at all times at once, so one may stop when it is short enough.

    All p for which the Beta(1/2, 1/2) mixture of likelihoods is below 1 / (1 - level) times p's own (Robbins 1970).

    Raises:
        ValueError: k is not in 0..n.
    """
    if not 0 <= k <= n:
        raise ValueError(f"{k} successes in {n} trials is impossible")
    limit = _log_beta(k + 0.5, n - k + 0.5) - _log_beta(0.5, 0.5) + np.log(1 - level)

    def inside(p: float) -> bool:
        """Whether this rate is still in the interval."""
        own = (k * np.log(p) if k else 0.0) + ((n - k) * np.log1p(-p) if n - k else 0.0)
        return bool(own >= limit)

    centre = min(max(k / n if n else 0.5, 1e-12), 1 - 1e-12)
    low = 0.0 if k == 0 else _edge(inside, centre, 0.0)
    high = 1.0 if k == n else _edge(inside, centre, 1.0)
    return low, high


def _edge(inside: Callable[[float], bool], centre: float, end: float) -> float:
    """Where `inside` turns false between the centre and an end, by bisection."""
    good, bad = centre, end
    for _ in range(60):
        middle = (good + bad) / 2
        good, bad = (middle, bad) if inside(middle) else (good, middle)
    return good


def _log_likelihood(p: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of Bernoulli outcomes at these rates."""
    return np.asarray(y * np.log(p) + (1 - y) * np.log1p(-p))


def _sequential(e: NDArray[np.float64]) -> Sequential:
    """The course of an E-process: when it decided, and its p-value."""
    if not len(e):
        return Sequential((), 1.0, None)
    crossed = np.flatnonzero(e >= 20.0)
    best = float(e.max())
    return Sequential(tuple(float(x) for x in e), min(1.0, 1.0 / best), int(crossed[0]) + 1 if len(crossed) else None)


def _log_beta(a: float, b: float) -> float:
    """Logarithm of the beta function."""
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)
