"""Rounds, not attempts, are the units: coverage of the intervals when attempts of a round go the same way."""

import numpy as np
import pytest
from scipy.stats import binom, t

from evg_app.trials.bootstrap import cluster_bootstrap
from evg_app.trials.rounds import design_effect, round_interval
from evg_app.trials.statistics import wilson
from evg_app.trials.student import t_quantile

COVERAGE = (0.94, 0.96)
"""Mean coverage of a 95 % interval over a grid."""
SAMPLING = 0.011
"""Of the mean over 1800 simulated runs: two standard errors."""
QUANTILE_RTOL = 1e-8
LEAST_BOOTSTRAP_COVERAGE = {15: 0.90, 50: 0.92, 200: 0.92}
"""By rounds, with 200 runs each (standard error 0.016); measured with 2000 runs in docs/trials.md."""


def wilson_coverage(p: float, n: int) -> float:
    """Exactly: the probability of all outcomes whose interval holds p."""
    ends = np.array([wilson(k, n) for k in range(n + 1)])
    return float(binom.pmf(np.arange(n + 1), n, p)[(ends[:, 0] <= p) & (p <= ends[:, 1])].sum())


def test_wilson_s_mean_coverage_over_a_grid_of_rates_and_sizes_is_95_percent():
    grid = [(p, n) for p in np.linspace(0.05, 0.99, 48) for n in (20, 45, 79, 150, 300)]
    coverages = [wilson_coverage(float(p), n) for p, n in grid]
    assert COVERAGE[0] <= float(np.mean(coverages)) <= COVERAGE[1]


def clustered_run(rng: np.random.Generator, rounds: int, rate: float, spread: float):
    """Rounds of three to eight attempts whose rate varies between rounds (beta, `spread` = intra-round correlation)."""
    a, b = rate * (1 - spread) / spread, (1 - rate) * (1 - spread) / spread
    trials = rng.integers(3, 9, rounds)
    return rng.binomial(trials, rng.beta(a, b, rounds)), trials


@pytest.mark.parametrize("rounds", [15, 50, 200])
def test_the_bootstrap_covers_where_attempts_of_a_round_are_alike(rounds, monkeypatch):
    monkeypatch.setattr("evg_app.trials.bootstrap.NUMBERS", 400 * rounds)
    rng, rate, runs = np.random.default_rng(rounds), 0.8, 200
    hits = 0
    for i in range(runs):
        low, high = cluster_bootstrap(*clustered_run(rng, rounds, rate, 0.3), seed=i) or (0.0, 1.0)
        hits += low <= rate <= high
    assert hits / runs >= LEAST_BOOTSTRAP_COVERAGE[rounds]


@pytest.mark.parametrize("rounds", [15, 50, 200])
def test_the_interval_by_rounds_covers_95_percent_over_a_grid_of_rates_and_correlations(rounds):
    rng, runs, hits = np.random.default_rng(rounds), 150, []
    for rate in (0.5, 0.7, 0.8, 0.9):
        for spread in (0.01, 0.05, 0.3):
            for _ in range(runs):
                low, high = round_interval(*clustered_run(rng, rounds, rate, spread)) or (0.0, 1.0)
                hits.append(low <= rate <= high)
    assert COVERAGE[0] - SAMPLING <= np.mean(hits) <= COVERAGE[1] + SAMPLING


def test_without_correlation_the_interval_by_rounds_is_wilson_s_with_a_larger_quantile():
    trials = [5] * 40
    assert round_interval([4] * 40, trials) == wilson(160, 200, t_quantile(0.975, 39)), "nothing varies"
    assert round_interval([5] * 40, trials) == wilson(200, 200, t_quantile(0.975, 39))


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 14, 49, 1999])
def test_the_quantiles_of_student_s_t_are_scipy_s(freedom):
    for p in (0.6, 0.9, 0.975, 0.995):
        assert t_quantile(p, freedom) == pytest.approx(t.ppf(p, freedom), rel=QUANTILE_RTOL)


def test_it_is_longer_than_wilson_s_interval_when_rounds_go_all_or_nothing():
    successes, trials = [5] * 20 + [0] * 10, [5] * 30
    low, high = cluster_bootstrap(successes, trials)
    w_low, w_high = wilson(100, 150)
    assert high - low > 1.5 * (w_high - w_low)
    assert design_effect(successes, trials) == pytest.approx(5.0, rel=0.05)


def test_the_design_effect_of_independent_attempts_is_about_one():
    rng = np.random.default_rng(0)
    trials = np.full(2000, 5)
    assert design_effect(rng.binomial(trials, 0.7), trials) == pytest.approx(1.0, abs=0.1)


def test_nothing_to_draw_from_is_said():
    assert round_interval([3], [4]) is None and round_interval([3, 0], [4, 0]) is None
    assert cluster_bootstrap([3], [4]) is None and cluster_bootstrap([], []) is None
    assert cluster_bootstrap([3, 0], [4, 0]) is None
    assert cluster_bootstrap([4, 5], [4, 5]) == pytest.approx(wilson(9, 9))
    assert design_effect([4, 5], [4, 5]) == 1.0


def test_the_same_log_gives_the_same_interval():
    assert cluster_bootstrap([3, 4, 2], [5, 4, 4]) == cluster_bootstrap([3, 4, 2], [5, 4, 4])
