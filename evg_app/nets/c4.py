"""C4-equivariant layers in plain PyTorch (spec §2.10).

Channels of a regular field are ordered (copy, orientation), flattened. Full filters follow from a
base filter: output orientation k uses rot90(roll(base, k over the input orientations), k).
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from evg_app.nets.expanded import ExpandedFilter
from evg_app.nets.fibres import ORDER, Fibre


def _regular_index(out_reg: int, in_reg: int, kernel: int) -> Tensor:
    """Index of a regular-to-regular filter into base (out_reg, in_reg, 4, kernel, kernel)."""
    base = torch.arange(out_reg * in_reg * ORDER * kernel**2).view(out_reg, in_reg, ORDER, kernel, kernel)
    copies = [torch.rot90(base.roll(k, 2), k, (3, 4)) for k in range(ORDER)]
    return torch.stack(copies, 1).reshape(ORDER * out_reg, ORDER * in_reg, kernel, kernel)


def lift_index(out_reg: int, in_channels: int, window: tuple[int, ...]) -> Tensor:
    """Index of an invariant-to-regular filter; the first two axes of `window` are x and y."""
    base = torch.arange(out_reg * in_channels * math.prod(window)).view(out_reg, in_channels, *window)
    copies = [torch.rot90(base, k, (2, 3)) for k in range(ORDER)]
    return torch.stack(copies, 1).reshape(ORDER * out_reg, in_channels, *window)


def regular_bias(copies: int) -> ExpandedFilter:
    """One bias per regular copy, shared by its four orientations, zero at first. Expands to (4 copies,)."""
    return ExpandedFilter(copies, torch.arange(copies).repeat_interleave(ORDER), None, 0.0)


class RegularConv2d(nn.Module):
    """Convolution between regular fields, 36 free numbers per pair of copies for 3x3."""

    def __init__(self, in_reg: int, out_reg: int, kernel: int = 3, gain: float = 2.0) -> None:
        super().__init__()
        index = _regular_index(out_reg, in_reg, kernel)
        std = math.sqrt(gain / (ORDER * in_reg * kernel**2))
        self.filter = ExpandedFilter(out_reg * in_reg * ORDER * kernel**2, index, None, std)
        self.bias = regular_bias(out_reg)
        self.padding = kernel // 2

    def forward(self, x: Tensor) -> Tensor:
        """(B, 4 in, H, W) -> (B, 4 out, H, W), (row, column) = (x, y)."""
        return F.conv2d(x, self.filter(), self.bias(), padding=self.padding)


class LiftConv2d(nn.Module):
    """Invariant channels to a regular field: output orientation k uses rot90(base, k)."""

    def __init__(self, in_channels: int, out_reg: int, kernel: int = 3) -> None:
        super().__init__()
        index = lift_index(out_reg, in_channels, (kernel, kernel))
        std = math.sqrt(2.0 / (in_channels * kernel**2))
        self.filter = ExpandedFilter(out_reg * in_channels * kernel**2, index, None, std)
        self.bias = regular_bias(out_reg)
        self.padding = kernel // 2

    def forward(self, x: Tensor) -> Tensor:
        """(B, in, H, W) -> (B, 4 out, H, W), (row, column) = (x, y)."""
        return F.conv2d(x, self.filter(), self.bias(), padding=self.padding)


class C4Linear(nn.Module):
    """Equivariant linear map between fibre types; bias on regular copies and invariants only.

    Free numbers per pair (same spaces as escnn): reg-reg 4, reg-triv 1, triv-reg 1, triv-triv 1,
    reg-vec 2, vec-reg 2, vec-vec 2; triv-vec none.

    Args:
        source: input type.
        target: output type.
        bias: whether to add the equivariant bias.
        gain: variance gain of the initialisation (2 after a ReLU, 1 otherwise).
        contrast: extra factor on maps from regular copies to vectors at initialisation. The four
            orientations of a copy are alike before training, so their differences are small.
    """

    def __init__(
        self, source: Fibre, target: Fibre, bias: bool = True, gain: float = 1.0, contrast: float = 1.0
    ) -> None:
        super().__init__()
        self.source, self.target = source, target
        index, sign, n_free = _linear_index(source, target)
        std = _linear_std(source, target, index, sign, gain, contrast)
        self.matrix = ExpandedFilter(n_free, index, sign, std)
        self.bias = _linear_bias(target) if bias and target.reg + target.triv else None

    def forward(self, x: Tensor) -> Tensor:
        """(..., source.size) -> (..., target.size)."""
        return F.linear(x, self.matrix(), None if self.bias is None else self.bias())


def _linear_bias(target: Fibre) -> ExpandedFilter:
    """One bias per regular copy and per invariant, none on vectors."""
    regular = torch.arange(target.reg).repeat_interleave(ORDER)
    rest = torch.arange(target.reg, target.reg + target.triv)
    index = torch.cat([regular, rest, torch.zeros(2 * target.vec, dtype=torch.long)])
    sign = (torch.arange(target.size) < target.offsets[2]).float() if target.vec else None
    return ExpandedFilter(target.reg + target.triv, index, sign, 0.0)


def _linear_index(source: Fibre, target: Fibre) -> tuple[Tensor, Tensor, int]:
    """Index and sign of the full matrix (target.size, source.size), and the number of free numbers."""
    index = torch.zeros(target.size, source.size, dtype=torch.long)
    sign = torch.zeros(target.size, source.size)
    used = 0
    for rows, n_out, out_kind in _parts(target):
        for columns, n_in, in_kind in _parts(source):
            if {out_kind, in_kind} == {"triv", "vec"}:
                continue
            block_index, block_sign, count = _block(out_kind, in_kind, n_out, n_in)
            index[rows, columns] = block_index + used
            sign[rows, columns] = block_sign
            used += count
    return index, sign, used


def _parts(fibre: Fibre) -> list[tuple[slice, int, str]]:
    """Channel range, multiplicity and kind of the non-empty parts of a fibre."""
    reg, triv, vec = fibre.offsets
    parts = [
        (slice(reg, triv), fibre.reg, "reg"),
        (slice(triv, vec), fibre.triv, "triv"),
        (slice(vec, fibre.size), fibre.vec, "vec"),
    ]
    return [part for part in parts if part[1]]


_DIM = {"reg": ORDER, "triv": 1, "vec": 2}


def _block(out_kind: str, in_kind: str, n_out: int, n_in: int) -> tuple[Tensor, Tensor, int]:
    """Index and sign of one block between n_in and n_out fields of one kind each, and its free numbers."""
    cell_index, cell_sign, count = _cell(out_kind, in_kind)
    pairs = torch.arange(n_out * n_in).view(n_out, n_in, 1, 1) * count
    rows, columns = n_out * _DIM[out_kind], n_in * _DIM[in_kind]
    index = (pairs + cell_index).transpose(1, 2).reshape(rows, columns)
    sign = cell_sign.expand(n_out, n_in, -1, -1).transpose(1, 2).reshape(rows, columns)
    return index, sign, n_out * n_in * count


def _cell(out_kind: str, in_kind: str) -> tuple[Tensor, Tensor, int]:
    """Index and sign of the map between two single fields, and its free numbers."""
    k = torch.arange(ORDER)
    if (out_kind, in_kind) == ("reg", "reg"):
        return (k[None] - k[:, None]) % ORDER, torch.ones(ORDER, ORDER), ORDER
    if "vec" not in (out_kind, in_kind):
        shape = (_DIM[out_kind], _DIM[in_kind])
        return torch.zeros(shape, dtype=torch.long), torch.ones(shape), 1
    if (out_kind, in_kind) == ("vec", "vec"):  # a I + b J
        return torch.tensor([[0, 1], [1, 0]]), torch.tensor([[1.0, -1.0], [1.0, 1.0]]), 2
    powers_index = torch.stack([k % 2, (k + 1) % 2], 1)  # J^k (a, b), one row per k
    powers_sign = torch.tensor([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    if out_kind == "reg":
        return powers_index, powers_sign, 2
    return powers_index.T, powers_sign.T, 2


def _linear_std(source: Fibre, target: Fibre, index: Tensor, sign: Tensor, gain: float, contrast: float) -> Tensor:
    """Standard deviation of each free number, He-like per output kind.

    A row of a regular output sees all regular and invariant channels; an invariant sums the four
    orientations of a copy with one weight (they are alike, so the fan counts twice); a vector sees
    only regular copies and vectors.
    """
    std = torch.zeros(int(index.max()) + 1)
    regular = slice(0, ORDER * source.reg)
    for rows, _, kind in _parts(target):
        fan = int((sign[rows][0] != 0).sum()) + (ORDER * source.reg if kind == "triv" else 0)
        std[index[rows][sign[rows] != 0]] = math.sqrt(gain / max(fan, 1))
        if kind == "vec":
            std[index[rows, regular]] *= contrast
    return std
