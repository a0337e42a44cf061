"""Comparison of two runs: equal to scipy and statsmodels on random tables, honest under the null hypothesis."""

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import hypergeom, permutation_test
from statsmodels.stats.proportion import (
    confint_proportions_2indep,
    proportion_confint,
    samplesize_proportions_2indep_onetail,
)

from evg_app.trials.compare import Counts, fisher, newcombe, paired_rounds_differ, rounds_differ, same_rounds
from evg_app.trials.sample_size import for_half_width, to_separate
from evg_app.trials.statistics import agreement, wilson

ATOL = 1e-9
MONTE_CARLO_ATOL = 0.02
"""20,000 random relabellings: five standard errors."""


def random_tables(n: int):
    rng = np.random.default_rng(4)
    for _ in range(n):
        n1, n2 = rng.integers(1, 120, 2)
        yield int(rng.integers(0, n1 + 1)), int(n1), int(rng.integers(0, n2 + 1)), int(n2)


def test_wilson_is_statsmodels_on_random_tables():
    for k, n, *_ in random_tables(300):
        assert wilson(k, n) == pytest.approx(proportion_confint(k, n, method="wilson"), abs=ATOL)


def test_newcombe_is_statsmodels_on_random_tables():
    for k1, n1, k2, n2 in random_tables(300):
        reference = confint_proportions_2indep(k1, n1, k2, n2, method="newcomb", compare="diff")
        assert newcombe(k1, n1, k2, n2) == pytest.approx(reference, abs=1e-7)


def test_fisher_is_the_sum_of_all_tables_that_are_no_likelier():
    for k1, n1, k2, n2 in random_tables(80):
        ways = hypergeom(n1 + n2, k1 + k2, n1).pmf(np.arange(n1 + 1))
        assert fisher(k1, n1, k2, n2) == pytest.approx(ways[ways <= ways[k1] * (1 + 1e-7)].sum(), abs=1e-7)


def test_the_paper_s_models_cannot_be_told_apart_with_75_objects():
    assert fisher(71, 79, 67, 81) == pytest.approx(0.25, abs=0.005)
    assert fisher(71, 79, 64, 82) == pytest.approx(0.054, abs=0.0005)
    assert fisher(71, 79, 66, 86) == pytest.approx(0.037, abs=0.0005)


def counts(rng, rounds, rate):
    trials = tuple(int(n) for n in rng.integers(3, 8, rounds))
    return Counts(tuple(int(rng.binomial(n, rate)) for n in trials), trials, tuple((0, i) for i in range(rounds)))


def difference(a, b):
    return sum(a.successes) / sum(a.trials) - sum(b.successes) / sum(b.trials)


def test_the_permutation_of_rounds_is_the_exact_one_when_all_splits_are_tried():
    rng = np.random.default_rng(1)
    a, b = counts(rng, 6, 0.9), counts(rng, 6, 0.6)
    s, n = np.array(a.successes + b.successes), np.array(a.trials + b.trials)
    seen, found = abs(difference(a, b)), []
    for first in combinations(range(12), 6):
        other = [i for i in range(12) if i not in first]
        one, two = list(first), other
        found.append(abs(s[one].sum() / n[one].sum() - s[two].sum() / n[two].sum()))
    assert rounds_differ(a, b) == pytest.approx(np.mean(np.array(found) >= seen - 1e-12), abs=MONTE_CARLO_ATOL)


@pytest.mark.parametrize("rounds", [8, 40])
def test_the_paired_permutation_is_scipy_s(rounds):
    rng = np.random.default_rng(rounds)
    a, b = counts(rng, rounds, 0.85), counts(rng, rounds, 0.75)
    trials_a, trials_b = np.array(a.trials, float), np.array(b.trials, float)

    def statistic(x, y, axis):
        sx, nx = np.floor(x), (x - np.floor(x)) * 100
        sy, ny = np.floor(y), (y - np.floor(y)) * 100
        return sx.sum(axis) / nx.sum(axis) - sy.sum(axis) / ny.sum(axis)

    packed = [np.array(c.successes) + t / 100 for c, t in ((a, trials_a), (b, trials_b))]
    reference = permutation_test(
        packed, statistic, permutation_type="samples", n_resamples=20000, rng=np.random.default_rng(0), vectorized=True
    )
    two_sided = np.mean(abs(reference.null_distribution) >= abs(difference(a, b)) - 1e-9)
    assert paired_rounds_differ(a, b) == pytest.approx(two_sided, abs=MONTE_CARLO_ATOL)


def test_pairs_are_found_by_the_name_of_the_round_not_by_their_order():
    rng = np.random.default_rng(5)
    a, b = counts(rng, 9, 0.9), counts(rng, 9, 0.6)
    turned = Counts(b.successes[::-1], b.trials[::-1], b.rounds[::-1])
    assert same_rounds(a, turned) and paired_rounds_differ(a, turned) == paired_rounds_differ(a, b)
    with pytest.raises(ValueError, match="not over the same rounds"):
        paired_rounds_differ(a, Counts(b.successes[1:], b.trials[1:], b.rounds[1:]))


def test_under_the_null_hypothesis_the_round_test_says_5_percent_about_5_percent_of_the_time(monkeypatch):
    monkeypatch.setattr("evg_app.trials.compare.PERMUTATIONS", 400)
    rng, runs = np.random.default_rng(7), 300
    false = sum(rounds_differ(counts(rng, 15, 0.8), counts(rng, 15, 0.8)) <= 0.05 for _ in range(runs))
    assert false / runs < 0.09


def test_trials_needed_to_separate_are_statsmodels():
    rng = np.random.default_rng(2)
    for _ in range(100):
        p1, p2 = rng.uniform(0.05, 0.95, 2)
        if abs(p1 - p2) < 0.02:
            continue
        reference = samplesize_proportions_2indep_onetail(p1 - p2, p2, 0.8, ratio=1, alpha=0.05)
        assert abs(to_separate(p1, p2) - reference) <= 1.0
    assert to_separate(0.9, 0.8) == 199 and to_separate(0.8, 0.8) is None


def test_trials_needed_for_a_precision_are_the_fewest():
    for p, half in ((0.9, 0.05), (0.5, 0.05), (0.8, 0.1)):
        n = for_half_width(p, half)
        low, high = wilson(round(p * n), n)
        assert high - low <= 2 * half
        low, high = wilson(round(p * (n - 1)), n - 1)
        assert high - low > 2 * half


def test_kappa_is_cohen_s():
    from statsmodels.stats.inter_rater import cohens_kappa

    rng = np.random.default_rng(3)
    for _ in range(50):
        pairs = [(bool(x), bool(y)) for x, y in rng.random((40, 2)) < [0.7, 0.6]]
        table = np.zeros((2, 2))
        for x, y in pairs:
            table[int(x), int(y)] += 1
        assert agreement(pairs)["kappa"] == pytest.approx(cohens_kappa(table).kappa, abs=ATOL)
    assert agreement([])["kappa"] is None and agreement([(True, True)])["kappa"] is None
