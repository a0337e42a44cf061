"""Numbers one may publish: intervals, rates, picks per hour, confusion."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evg_app.trials.statistics import (
    confusion,
    fraction,
    median_p95,
    picks_per_hour,
    rate,
    tally,
    wilson,
)

PERCENT_ATOL = 0.05
"""Published intervals are rounded to a tenth of a percent."""
ATOL = 1e-9


@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    [(71, 79, 81.3, 94.8), (67, 87, 67.1, 84.6), (74, 84, 79.5, 93.4), (67, 81, 73.1, 89.4)],
)
def test_the_paper_s_counts_give_the_known_intervals(k, n, low, high):
    assert [100 * x for x in wilson(k, n)] == pytest.approx([low, high], abs=PERCENT_ATOL)


@given(n=st.integers(1, 400), data=st.data())
def test_the_interval_ends_solve_the_score_equation(n, data):
    """At an end p of the interval, |k/n - p| is z standard errors of p."""
    k = data.draw(st.integers(0, n))
    for p in wilson(k, n):
        if 0.0 < p < 1.0:
            assert abs(k / n - p) == pytest.approx(1.959963984540054 * math.sqrt(p * (1 - p) / n), abs=ATOL)


@given(n=st.integers(1, 400), data=st.data())
def test_the_interval_holds_the_rate_and_mirrors(n, data):
    k = data.draw(st.integers(0, n))
    low, high = wilson(k, n)
    assert 0.0 <= low <= k / n <= high <= 1.0
    assert wilson(n - k, n) == pytest.approx((1 - high, 1 - low), abs=ATOL)


def test_nothing_tried_is_said_and_never_divided_by():
    assert wilson(0, 0) == (0.0, 1.0)
    assert fraction(0, 0) == 0.0
    assert rate(0, 0) == "0/0 = no trial"
    assert median_p95([]) == {"median": None, "p95": None}
    assert picks_per_hour(0, 0.0, 0.0) == 0.0


@pytest.mark.parametrize(("k", "n"), [(-1, 3), (4, 3)])
def test_impossible_counts_are_refused(k, n):
    with pytest.raises(ValueError, match="impossible"):
        wilson(k, n)


def test_a_rate_is_printed_with_counts_percent_and_interval():
    assert rate(71, 79) == "71/79 = 89.9 % [81.3, 94.8]"


def test_picks_per_hour_counts_motion_and_computing():
    assert picks_per_hour(10, 90.0, 10.0) == pytest.approx(360.0)


def test_confusion_names_verify_first():
    table = confusion([(True, True), (True, True), (True, False), (False, True), (False, False)])
    assert table == {"true_positive": 2, "false_positive": 1, "false_negative": 1, "true_negative": 1}


def test_a_tally_is_sorted_and_leaves_out_nothing_said():
    assert tally(["b", "a", "b", "", None]) == {"b": 2, "a": 1}
    assert median_p95([1.0, 2.0, 3.0])["median"] == 2.0
