"""Trained C4 layers as plain matrices: what an equivariant layer computes is an ordinary affine map, so maps in a row
are multiplied out once, in double precision."""

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor, nn

from evg_app.nets.c4 import C4Linear


@dataclass(frozen=True)
class Affine:
    """x -> x @ weight + bias, float64.

    Attributes:
        weight: shape (inputs, outputs).
        bias: shape (outputs,).
    """

    weight: Tensor
    bias: Tensor

    @classmethod
    def of(cls, layer: nn.Module) -> Self:
        """What a C4Linear computes."""
        assert isinstance(layer, C4Linear)
        weight = layer.matrix.expand().detach().double().cpu().T
        bias = torch.zeros_like(weight[0]) if layer.bias is None else layer.bias.expand().detach().double().cpu()
        return cls(weight, bias)

    def then(self, following: "Affine") -> "Affine":
        """The map that applies this one first."""
        return Affine(self.weight @ following.weight, self.bias @ following.weight + following.bias)

    def beside(self, other: "Affine") -> "Affine":
        """The map of one input to both outputs, side by side."""
        return Affine(torch.cat([self.weight, other.weight], 1), torch.cat([self.bias, other.bias]))

    def plus(self, other: "Affine") -> "Affine":
        """The map of both inputs, side by side, to the sum of the outputs."""
        return Affine(torch.cat([self.weight, other.weight]), self.bias + other.bias)

    def shifted(self, bias: Tensor) -> "Affine":
        """The same with more bias."""
        return Affine(self.weight, self.bias + bias)

    @staticmethod
    def linear(weight: Tensor) -> "Affine":
        """Without a bias."""
        return Affine(weight.double(), torch.zeros(weight.shape[1], dtype=torch.float64))
