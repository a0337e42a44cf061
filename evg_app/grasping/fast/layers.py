"""Trained C4 layers as plain matrices, chains of them folded into one, run without allocating.

What an equivariant layer computes is an ordinary affine map, so maps in a row are multiplied out once. A residual
trunk then is a sequence of `addmm` into buffers that fit the second-level cache.
"""

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor, nn

from evg_app.nets.c4 import C4Linear
from evg_app.nets.heads import ConditionedTrunk, Head, ResidualBlock


@dataclass(frozen=True)
class Affine:
    """x -> x @ weight + bias.

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
        weight = layer.matrix.expand().detach().double().T
        bias = weight.new_zeros(weight.shape[1]) if layer.bias is None else layer.bias.expand().detach().double()
        return cls(weight, bias)

    def then(self, following: "Affine") -> "Affine":
        """The map that applies this one first."""
        return Affine(self.weight @ following.weight, self.bias @ following.weight + following.bias)

    def beside(self, other: "Affine") -> "Affine":
        """The map of one input to both outputs."""
        return Affine(torch.cat([self.weight, other.weight], 1), torch.cat([self.bias, other.bias]))

    def plus(self, other: "Affine") -> "Affine":
        """The map of both inputs, side by side, to the sum of the outputs."""
        return Affine(torch.cat([self.weight, other.weight]), self.bias + other.bias)

    def final(self, device: torch.device) -> "Affine":
        """The map as it is run: float32, contiguous, on the device."""
        return Affine(*(x.to(device, torch.float32).contiguous() for x in (self.weight, self.bias)))

    def __call__(self, x: Tensor, out: Tensor) -> Tensor:
        """The map of x (N, inputs), into `out` (N, outputs)."""
        return torch.addmm(self.bias, x, self.weight, out=out)


class Buffers:
    """Memory that is reused from call to call; one for each thread."""

    def __init__(self, device: torch.device) -> None:
        self._device, self._kept = device, dict[str, Tensor]()

    def take(self, name: str, *shape: int) -> Tensor:
        """An uninitialised float32 tensor; it holds until the name is taken again."""
        size = 1
        for side in shape:
            size *= side
        kept = self._kept.get(name)
        if kept is None or len(kept) < size:
            kept = self._kept[name] = torch.empty(size, device=self._device)
        return kept[:size].view(shape)


class Trunk:
    """`ConditionedTrunk` between a start and a last layer: net += Linear_i(context), net = Block_i(net), last(net).

    The bias of a block's second layer waits for the next addition, that of the last block goes into the last layer.

    Attributes:
        inject: what each block adds, not yet `final`.
    """

    def __init__(self, trunk: ConditionedTrunk, last: Affine, name: str, device: torch.device) -> None:
        blocks = [block for block in trunk.blocks if isinstance(block, ResidualBlock)]
        seconds = [Affine.of(block.second) for block in blocks]
        self.inject = [Affine.of(layer) for layer in trunk.inject]
        for i, second in enumerate(seconds[:-1], 1):
            self.inject[i] = Affine(self.inject[i].weight, self.inject[i].bias + second.bias)
        self._first = [Affine.of(block.first).final(device) for block in blocks]
        self._second = [second.final(device).weight for second in seconds]
        self._last = Affine(last.weight, seconds[-1].bias @ last.weight + last.bias).final(device)
        self._name = name

    @property
    def width(self) -> int:
        """Channels of the hidden feature."""
        return self._second[0].shape[0]

    def block(self, i: int, net: Tensor, buffers: Buffers) -> None:
        """Block i on net (N, width), in place."""
        active = torch.clamp_min(net, 0.0, out=buffers.take(f"{self._name}.active", *net.shape))
        hidden = self._first[i](active, buffers.take(f"{self._name}.hidden", *net.shape)).relu_()
        net.addmm_(hidden, self._second[i])

    def last(self, net: Tensor) -> Tensor:
        """The result at net (N, width). (N, outputs), memory of its own."""
        return torch.addmm(self._last.bias, net, self._last.weight)


class FoldedHead:
    """A `Head` after an affine map, None for none; `name` is that of its buffers."""

    def __init__(self, head: Head, before: Affine | None, name: str, device: torch.device) -> None:
        context = Affine.of(head.context)
        self._context = (context if before is None else before.then(context)).final(device)
        self._trunk = Trunk(head.trunk, Affine.of(head.out), name, device)
        self._inject = [inject.final(device) for inject in self._trunk.inject]
        self._name = name

    def __call__(self, x: Tensor, buffers: Buffers) -> Tensor:
        """What the head says of rows x (N, inputs). (N, outputs)."""
        shape = (len(x), self._trunk.width)
        context = self._context(x, buffers.take(f"{self._name}.context", *shape)).relu_()
        net = self._inject[0](context, buffers.take(f"{self._name}.net", *shape))
        for i, inject in enumerate(self._inject):
            if i:
                net.add_(inject.bias).addmm_(context, inject.weight)
            self._trunk.block(i, net, buffers)
        return self._trunk.last(net)
