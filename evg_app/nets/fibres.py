"""Fibre types of C4 features and how a quarter turn acts on their channels (spec §2.10).

A fibre holds `reg` copies of the regular representation (4 channels each, one per orientation),
`triv` invariants and `vec` planar vectors (irrep 1, 2 channels each), stored in this order.
A turn by +90 degrees about z rolls the four channels of a regular copy by +1, leaves invariants
alone and multiplies vectors by J = [[0, -1], [1, 0]]. On planes with (row, column) = (x, y) it is
`torch.rot90(k=1, dims=(x, y))`.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

ORDER = 4
"""Number of elements of C4."""


@dataclass(frozen=True)
class Fibre:
    """Type of a feature: numbers of regular copies, invariants and planar vectors."""

    reg: int = 0
    triv: int = 0
    vec: int = 0

    @property
    def size(self) -> int:
        """Number of channels."""
        return ORDER * self.reg + self.triv + 2 * self.vec

    @property
    def offsets(self) -> tuple[int, int, int]:
        """First channel of the regular, the invariant and the vector part."""
        return 0, ORDER * self.reg, ORDER * self.reg + self.triv


def turn_fibre(x: Tensor, fibre: Fibre, turns: int) -> Tensor:
    """Channels x (..., fibre.size) after the scene has turned by `turns` * 90 degrees about z."""
    _, triv, vec = fibre.offsets
    regular = x[..., :triv].reshape(*x.shape[:-1], fibre.reg, ORDER).roll(turns, -1).flatten(-2)
    vectors = x[..., vec:].reshape(*x.shape[:-1], fibre.vec, 2)
    for _ in range(turns % ORDER):
        vectors = torch.stack([-vectors[..., 1], vectors[..., 0]], -1)
    return torch.cat([regular, x[..., triv:vec], vectors.flatten(-2)], -1)
