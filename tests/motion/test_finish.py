"""Routes of an empty hand: looked for once, searched for only when asked and needed."""

import numpy as np

from evg_app.motion.finish import EmptyHanded
from evg_app.motion.path import line


class CountingRouter:
    """Finds straight lines; to joint values above 1 only by search, above 2 never."""

    def __init__(self):
        self.calls = []

    def connect(self, a, b, scene, search):
        """As the real one."""
        self.calls.append(search)
        found = b[0] <= 1 or (search and b[0] <= 2)
        return line(a, b) if found else None


def asked(goal, *searches):
    """What is answered and which calls were made when a goal is asked for several times."""
    router = CountingRouter()
    routes = EmptyHanded(router, None)
    return [routes.connect(np.zeros(7), np.full(7, goal), search) is not None for search in searches], router.calls


def test_a_route_is_looked_for_once():
    assert asked(0.5, False, True, False) == ([True] * 3, [False])


def test_the_search_comes_only_after_the_simple_ways_and_once():
    assert asked(1.5, False, False, True, True, False) == ([False, False, True, True, True], [False, True])
    assert asked(2.5, True, True) == ([False, False], [False, True])
