"""One may look after every attempt: false alarms stay below 5 % however often one looks."""

import numpy as np
import pytest

from evg_app.trials.sequential import attempts_differ, rate_sequence, rounds_differ
from evg_app.trials.statistics import wilson

MOST_FALSE_ALARMS = 0.05
"""Guaranteed by Ville's inequality, up to simulation noise of `NOISE`."""
NOISE = 0.03
RUNS = 300


@pytest.mark.parametrize("rate", [0.5, 0.8, 0.95])
def test_equal_rates_are_rarely_called_different_at_any_look(rate):
    rng = np.random.default_rng(0)
    alarms = sum(attempts_differ(*(rng.random((2, 400)) < rate)).decided_at is not None for _ in range(RUNS))
    assert alarms / RUNS <= MOST_FALSE_ALARMS + NOISE


def test_peeking_with_fisher_instead_would_raise_false_alarms():
    """Why the sequential test exists: the same looks with the fixed-sample test go wrong far more often."""
    from evg_app.trials.compare import fisher

    rng, alarms = np.random.default_rng(1), 0
    for _ in range(40):
        a, b = (rng.random((2, 200)) < 0.8).cumsum(axis=1)
        alarms += any(fisher(int(a[n - 1]), n, int(b[n - 1]), n) <= 0.05 for n in range(10, 201, 10))
    assert alarms / 40 > 0.08


def test_different_rates_are_found_and_the_run_may_stop_early():
    rng = np.random.default_rng(2)
    decided = [attempts_differ(rng.random(600) < 0.9, rng.random(600) < 0.6).decided_at for _ in range(50)]
    assert all(step is not None for step in decided) and np.median(decided) < 80


def test_rounds_that_go_the_same_way_do_not_fool_the_test_on_rounds():
    """Attempts of a round all alike, each run with its own scenes: the attempts test is not made for that."""
    rng, alarms = np.random.default_rng(3), 0
    for _ in range(RUNS):
        a, b = rng.beta(0.6, 0.2, (2, 100))
        alarms += rounds_differ(a, b).decided_at is not None
    assert alarms / RUNS <= MOST_FALSE_ALARMS + NOISE


def test_rounds_that_differ_are_found():
    rng = np.random.default_rng(4)
    found = rounds_differ(rng.binomial(5, 0.9, 100) / 5, rng.binomial(5, 0.6, 100) / 5)
    assert found.decided_at is not None and found.p < 0.05


def test_evidence_is_symmetric_and_starts_from_nothing():
    a, b = np.array([1, 1, 0, 1], bool), np.array([0, 1, 0, 0], bool)
    assert attempts_differ(a, b).e == pytest.approx(attempts_differ(b, a).e)
    assert attempts_differ([], [True]).p == 1.0 and attempts_differ([], []).decided_at is None
    assert rounds_differ([0.5], [0.5]).p == 1.0


def test_the_interval_that_holds_at_all_times_does():
    rng, rate, misses = np.random.default_rng(5), 0.85, 0
    for _ in range(100):
        k = (rng.random(150) < rate).cumsum()
        looks = (rate_sequence(int(k[n - 1]), n) for n in (*range(1, 20, 2), *range(20, 151, 10)))
        misses += any(not low <= rate <= high for low, high in looks)
    assert misses / 100 <= MOST_FALSE_ALARMS + NOISE


def test_it_is_longer_than_wilson_s_which_holds_at_one_time_only():
    for k, n in ((0, 5), (71, 79), (40, 40)):
        (low, high), (w_low, w_high) = rate_sequence(k, n), wilson(k, n)
        assert low <= k / n <= high and high - low > w_high - w_low
    assert rate_sequence(0, 0) == (0.0, 1.0)
