"""RRT-Connect in joint space: seeded, and bounded by iterations instead of time, so equal inputs give equal paths."""

from collections.abc import Callable

import numpy as np

from evg_app.geometry import Array

MAX_ITERATIONS = 150
"""Samples that are tried before the search gives up."""
STEP = 0.35
"""Longest edge of the trees [rad]."""
SHORTCUTS = 40
"""Random shortcuts that are tried on the path found."""

EdgeFree = Callable[[Array, Array], bool]


class _Tree:
    """Configurations with the index of their parent."""

    def __init__(self, root: Array) -> None:
        self._q = root[None].copy()
        self._parent = [-1]

    def nearest(self, q: Array) -> int:
        return int(np.argmin(((self._q - q) ** 2).sum(axis=1)))

    def node(self, index: int) -> Array:
        node: Array = self._q[index]
        return node

    def add(self, q: Array, parent: int) -> int:
        self._q = np.concatenate([self._q, q[None]])
        self._parent.append(parent)
        return len(self._parent) - 1

    def branch(self, index: int) -> list[Array]:
        """From the root to the node."""
        nodes = []
        while index >= 0:
            nodes.append(self._q[index])
            index = self._parent[index]
        return nodes[::-1]


def _extend(tree: _Tree, target: Array, edge_free: EdgeFree) -> int | None:
    """Add a node at most `STEP` towards `target`; None when the edge is blocked."""
    near = tree.nearest(target)
    q = tree.node(near)
    gap = target - q
    distance = float(np.linalg.norm(gap))
    new = target if distance <= STEP else q + gap * (STEP / distance)
    return tree.add(new, near) if edge_free(q, new) else None


def rrt_connect(start: Array, goal: Array, low: Array, high: Array, edge_free: EdgeFree, seed: int = 0) -> Array | None:
    """Waypoints (W, J) from `start` to `goal` whose straight edges are free, or None when none was found.

    Args:
        start, goal: shape (J,), both free.
        low, high: bounds of the samples [rad]. Shape (J,).
        edge_free: whether the straight line between two configurations is free.
        seed: of the samples.
    """
    rng = np.random.default_rng(seed)
    trees = [_Tree(start), _Tree(goal)]
    for iteration in range(MAX_ITERATIONS):
        a, b = trees[iteration % 2], trees[1 - iteration % 2]
        middle = (start + goal) / 2
        sample = rng.uniform(low, high) if rng.random() < 0.6 else middle + rng.normal(0.0, 0.5, len(start))
        new = _extend(a, np.clip(sample, low, high), edge_free)
        if new is None:
            continue
        target = a.node(new)
        met = _extend(b, target, edge_free)
        while met is not None and not np.array_equal(b.node(met), target):
            met = _extend(b, target, edge_free)
        if met is not None:
            first, second = a.branch(new), b.branch(met)
            path = first + second[::-1][1:] if iteration % 2 == 0 else second + first[::-1][1:]
            return shortcut(np.stack(path), edge_free, rng)
    return None


def shortcut(path: Array, edge_free: EdgeFree, rng: np.random.Generator) -> Array:
    """Leave out waypoints between which the straight edge is free."""
    for _ in range(SHORTCUTS):
        if len(path) < 3:
            break
        i, j = np.sort(rng.choice(len(path), 2, replace=False))
        if j - i > 1 and edge_free(path[i], path[j]):
            path = np.concatenate([path[: i + 1], path[j:]])
    return path
