"""OMPL's search finds ways round, is a function of its seed, gives up after a bounded effort, and checks every edge."""

from itertools import pairwise

import numpy as np
import pytest

from evg_app.motion.search import search

LOW, HIGH = np.full(7, -2.0), np.full(7, 2.0)
START, GOAL = np.zeros(7), np.array([1.0, 0, 0, 0, 0, 0, 0])


def around_a_wall(p, q):
    """A wall at joint 1 between 0.4 and 0.6 wherever joint 2 is below 1."""
    x = p + np.linspace(0, 1, 60)[:, None] * (q - p)
    return bool((~((x[:, 0] > 0.4) & (x[:, 0] < 0.6) & (x[:, 1] < 1.0))).all())


def test_a_way_round_is_found_and_every_edge_is_free():
    path = search(START, GOAL, LOW, HIGH, around_a_wall)
    np.testing.assert_array_equal(path[[0, -1]], [START, GOAL])
    assert all(around_a_wall(a, b) for a, b in pairwise(path))
    assert path[:, 1].max() > 1.0


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_equal_seeds_give_equal_paths_whatever_was_searched_before(seed):
    first = search(START, GOAL, LOW, HIGH, around_a_wall, seed)
    search(START, -GOAL, LOW, HIGH, around_a_wall, seed + 10)
    np.testing.assert_array_equal(search(START, GOAL, LOW, HIGH, around_a_wall, seed), first)


def test_the_search_gives_up_when_there_is_no_way():
    calls = []

    def never(p, q):
        calls.append(0)
        return False

    assert search(START, GOAL, LOW, HIGH, never) is None
    assert 0 < len(calls) < 2000


def test_ends_may_lie_outside_the_bounds_of_the_samples():
    start = START - np.array([0, 0, 2.02, 0, 0, 0, 0])
    path = search(start, GOAL, LOW, HIGH, around_a_wall)
    np.testing.assert_array_equal(path[[0, -1]], [start, GOAL])
