"""Residual heads and the rotation flow as parts of graphs."""

import torch

from evg_app.grasping.fast.affine import Affine
from evg_app.grasping.fast.graph import Graph
from evg_app.nets.flow import RotationFlow
from evg_app.nets.heads import ConditionedTrunk, Head, ResidualBlock

_TO_ROWS = [0, 2, 4, 1, 3, 5]
"""Where the numbers of row order stand in the order of irreps (`nets.rotation`)."""


def head(g: Graph, x: str, trained: Head, before: Affine | None = None, to_rows: bool = False) -> str:
    """A head after an affine map (None: after nothing), from rows x (N, inputs) to answers (N, outputs).

    `to_rows` brings the six numbers of a rotation from the order of irreps into row order.
    """
    context = Affine.of(trained.context)
    context = context if before is None else before.then(context)
    trunk = _Trunk(trained.trunk, _in_rows(trained.out) if to_rows else Affine.of(trained.out))
    seen = g.affine(x, context, relu=True)
    net = g.affine(seen, trunk.inject[0])
    for i, inject in enumerate(trunk.inject):
        if i:
            net = g.add("Add", net, g.affine(seen, inject))
        net = trunk.block(g, i, net)
    return g.affine(net, trunk.last)


def flow(g: Graph, x: str, noise: str, trained: RotationFlow, before: Affine, draws: int, steps: int) -> str:
    """Euler steps of the flow: rows x (N, inputs) and noise (draws * N, 6) to six numbers (draws * N, 6), row order."""
    trunk = _Trunk(trained.trunk, _in_rows(trained.out))
    start = Affine.of(trained.start)
    start = Affine(start.weight[_TO_ROWS], start.bias)
    seen = g.affine(x, before.then(Affine.of(trained.context)), relu=True)
    prepared = [g.add("Concat", *[g.affine(seen, inject)] * draws, axis=0) for inject in trunk.inject]
    with torch.no_grad():
        code = trained.time(torch.arange(steps, device=trained.time.frequencies.device) / steps).double().cpu()
    times = [code @ Affine.of(layer).weight for layer in trained.inject_time]
    rows, length = noise, g.constant(torch.tensor(1.0 / steps))
    for step in range(steps):
        net = g.add("Add", g.affine(rows, start.shifted(times[0][step])), prepared[0])
        for i in range(len(prepared)):
            if i:
                net = g.add("Add", net, g.add("Add", prepared[i], g.constant(times[i][step])))
            net = trunk.block(g, i, net)
        rows = g.add("Add", rows, g.add("Mul", g.affine(net, trunk.last), length))
    return rows


class _Trunk:
    """`ConditionedTrunk` and the layer after it as affine maps.

    The bias of a block's second layer waits for the next addition, that of the last block goes into the last layer.

    Attributes:
        inject: what each block adds, from the context.
        last: the layer after the trunk.
    """

    def __init__(self, trunk: ConditionedTrunk, last: Affine) -> None:
        blocks = [block for block in trunk.blocks if isinstance(block, ResidualBlock)]
        self._first = [Affine.of(block.first) for block in blocks]
        self._second = [Affine.of(block.second) for block in blocks]
        self.inject = [Affine.of(layer) for layer in trunk.inject]
        for i, second in enumerate(self._second[:-1], 1):
            self.inject[i] = self.inject[i].shifted(second.bias)
        self.last = last.shifted(self._second[-1].bias @ last.weight)

    def block(self, g: Graph, i: int, net: str) -> str:
        """Block i, without the last bias."""
        hidden = g.affine(g.add("Relu", net), self._first[i], relu=True)
        return g.add("Gemm", hidden, g.constant(self._second[i].weight), net)


def _in_rows(layer: torch.nn.Module) -> Affine:
    """A layer that answers with a rotation's six numbers, in row order."""
    out = Affine.of(layer)
    return Affine(out.weight[:, _TO_ROWS], out.bias[_TO_ROWS])
