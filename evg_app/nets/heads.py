"""Equivariant residual heads: features at a point to logits, widths and vectors (spec §2.2)."""

import torch.nn.functional as F
from torch import Tensor, nn

from evg_app.nets.c4 import C4Linear
from evg_app.nets.fibres import Fibre

RESIDUAL_START = 0.25
"""Factor on the last layer of a residual branch at initialisation: there are no normalisation layers."""


CONTRAST = 8.0
"""Factor on maps to vectors at initialisation, where these are made from features of a point."""


class ResidualBlock(nn.Module):
    """x + Linear(ReLU(Linear(ReLU(x)))) on a type of regular copies and invariants."""

    def __init__(self, fibre: Fibre) -> None:
        super().__init__()
        self.first = C4Linear(fibre, fibre, gain=2.0)
        self.second = C4Linear(fibre, fibre, gain=2.0)
        self.second.matrix.scale_(RESIDUAL_START)

    def forward(self, x: Tensor) -> Tensor:
        """(..., fibre.size) -> (..., fibre.size)."""
        out: Tensor = self.second(F.relu_(self.first(F.relu(x))))
        return x + out


class ConditionedTrunk(nn.Module):
    """The head's body: `blocks` times net += Linear_i(context); net = Block_i(net)."""

    def __init__(self, fibre: Fibre, blocks: int) -> None:
        super().__init__()
        self.inject = nn.ModuleList(C4Linear(fibre, fibre, gain=2.0) for _ in range(blocks))
        self.blocks = nn.ModuleList(ResidualBlock(fibre) for _ in range(blocks))
        for layer in self.inject:
            assert isinstance(layer, C4Linear)
            layer.matrix.scale_(blocks**-0.5)

    def prepare(self, context: Tensor) -> list[Tensor]:
        """What each block adds: Linear_i(context). Reusable while the context stays."""
        return [layer(context) for layer in self.inject]

    def forward(self, additions: list[Tensor], start: Tensor | None = None) -> Tensor:
        """Run the blocks from `start` (zero if None)."""
        net = start
        for addition, block in zip(additions, self.blocks, strict=True):
            net = block(addition if net is None else net + addition)
        if net is None:
            raise ValueError("a head needs at least one block")
        return net


class Head(nn.Module):
    """Residual decoder of one point feature (spec §2.2).

    Args:
        source: type of the point feature.
        hidden: type of the hidden feature (regular copies and invariants).
        target: type of the output, e.g. `Fibre(triv=1)` for a logit or `Fibre(vec=3)` for a rotation.
        blocks: number of residual blocks.
    """

    def __init__(self, source: Fibre, hidden: Fibre, target: Fibre, blocks: int) -> None:
        super().__init__()
        self.context = C4Linear(source, hidden)
        self.trunk = ConditionedTrunk(hidden, blocks)
        self.out = C4Linear(hidden, target, contrast=CONTRAST)

    def forward(self, c: Tensor) -> Tensor:
        """(..., source.size) -> (..., target.size)."""
        out: Tensor = self.out(self.trunk(self.trunk.prepare(F.relu_(self.context(c)))))
        return out
