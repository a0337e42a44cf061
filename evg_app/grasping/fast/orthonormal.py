"""`nets.rotation.from_rows` as part of a graph."""

import numpy as np

from evg_app.grasping.fast.graph import Graph

EPS = 1e-10
"""Floor of the lengths divided by, as in `from_rows`."""
_NEXT, _LAST = np.roll(np.eye(3, dtype=np.float32), -1, 1), np.roll(np.eye(3, dtype=np.float32), 1, 1)


def from_rows(g: Graph, rows: str) -> str:
    """Nearest rotations (N, 9) to six numbers in row order (N, 6)."""
    first, second = (g.add("MatMul", rows, g.constant(np.eye(6, dtype=np.float32)[:, i : i + 3])) for i in (0, 3))
    normal = _unit(g, _cross(g, first, second))
    e1 = _unit(g, g.add("Add", first, _cross(g, second, normal)))
    e2 = _cross(g, normal, e1)
    return g.add("Concat", e1, e2, _cross(g, e1, e2), axis=1)


def _cross(g: Graph, a: str, b: str) -> str:
    """Cross products of rows (N, 3): with both cyclic orders side by side, one product and one difference."""
    forth, back = np.concatenate([_NEXT, _LAST], 1), np.concatenate([_LAST, _NEXT], 1)
    product = g.add("Mul", g.add("MatMul", a, g.constant(forth)), g.add("MatMul", b, g.constant(back)))
    return g.add("MatMul", product, g.constant(np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)))


def _unit(g: Graph, a: str) -> str:
    """Rows divided by their lengths."""
    length = g.add("ReduceL2", a, axes=[1], keepdims=1)
    return g.add("Div", a, g.add("Max", length, g.constant(np.full((), EPS, np.float32))))
