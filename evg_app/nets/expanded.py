"""Weights with symmetry: few free numbers, gathered with signs into the full filter.

Every C4 layer of this room is an ordinary linear or convolution layer whose full filter is
`sign * free[index]`. The constraint is thereby exact, the gradient is an index-add, and one
mechanism (with one cache) serves all layers. In eval mode without gradients the expanded filter
is kept until the free numbers change. `untie` makes ordinary layers of all of a network's: the same
architecture without the symmetry, to compare with.
"""

import torch
from torch import Tensor, nn


class ExpandedFilter(nn.Module):
    """Full filter made of free numbers.

    Args:
        n_free: how many free numbers there are.
        index: position of each entry's free number, shape of the full filter; where `sign` is 0 any value.
        sign: +1, -1 or 0 per entry, same shape; None where all are +1.
        std: standard deviation of the normal initialisation.
    """

    index: Tensor | None
    sign: Tensor | None

    def __init__(self, n_free: int, index: Tensor, sign: Tensor | None, std: Tensor | float) -> None:
        super().__init__()
        self.free = nn.Parameter(torch.randn(n_free) * std)
        self.shape = index.shape
        self.register_buffer("index", index.reshape(-1).contiguous(), persistent=False)
        self.register_buffer("sign", None if sign is None else sign.reshape(-1).contiguous(), persistent=False)
        self._cache: tuple[tuple[int, int, torch.dtype], Tensor] | None = None

    def expand(self) -> Tensor:
        """The full filter, computed now."""
        full = self.free if self.index is None else self.free.index_select(0, self.index)
        if self.sign is not None:
            full = full * self.sign
        return full.view(self.shape)

    def forward(self) -> Tensor:
        """The full filter; from the cache in eval mode without gradients, unless the free numbers changed."""
        if self.training or torch.is_grad_enabled():
            return self.expand()
        key = (self.free._version, self.free.data_ptr(), self.free.dtype)
        if self._cache is None or self._cache[0] != key:
            self._cache = (key, self.expand())
        return self._cache[1]

    def train(self, mode: bool = True) -> "ExpandedFilter":
        """Switch mode and forget the cached filter."""
        self._cache = None
        return super().train(mode)

    def __getstate__(self) -> dict[str, object]:
        """State for copies and workers, without the cache."""
        return {**self.__dict__, "_cache": None}

    @torch.no_grad()
    def scale_(self, factor: float) -> None:
        """Multiply the free numbers, e.g. to start a residual branch small."""
        self.free.mul_(factor)

    @torch.no_grad()
    def untie(self) -> None:
        """Every entry becomes a free number of its own; it keeps its size, and its sign is drawn anew."""
        full = self.expand().flatten()
        self.free = nn.Parameter(full * torch.randint(0, 2, full.shape).mul(2).sub(1))
        self.index = self.sign = self._cache = None


def untie(net: nn.Module) -> None:
    """Take the symmetry away from all layers of a network with random weights."""
    for module in net.modules():
        if isinstance(module, ExpandedFilter):
            module.untie()
