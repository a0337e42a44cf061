"""Reading encoded planes fast: whole rows at lattice points, weighted sums of rows anywhere else.

Points here are pixels: (x, y, z, PIXEL_W) with x = 0 at the centre of voxel 0. The fourth makes affine maps linear.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from evg_app.geometry import GRID_SIZE
from evg_app.grasping.fast.layers import Buffers

PIXEL_W = 1.5
"""Fourth number of a pixel: its whole part is 1, what is left is 0.5."""
GROUP = 8
"""Points whose corners one row of a matrix product holds where each is read alone."""
_AXES = ((0, 1), (0, 2), (1, 2))
"""Coordinates (row, column) that read the xy, xz and yz plane."""
_PLANES = ((0,), (1, 2))
"""Planes whose values are added: xy alone, both sides together."""


class Field:
    """The features of one scene, from planes as `Features.planes` of one scene, (3, 40, 40, C)."""

    def __init__(self, planes: Tensor) -> None:
        self.channels = planes.shape[-1]
        self.table = planes.reshape(-1, self.channels)
        self._lattices = {GRID_SIZE: planes.reshape(3, -1, self.channels)}

    def at_lattice(self, index: Tensor, side: int) -> Tensor:
        """Features (N, 2 C) at lattice points, where reading between pixels is reading one, or a mean of whole ones.

        Args:
            index: flat indices into the lattice (side, side, side). Shape (N,).
            side: 40 for voxel centres, 20 for the centres of their 2x2x2 blocks.
        """
        planes = self._lattice(side)
        i, jk = index // (side * side), index % (side * side)
        j, k = jk // side, jk % side
        xz = planes[1].index_select(0, i * side + k)
        return torch.cat([planes[0].index_select(0, i * side + j), xz.add_(planes[2].index_select(0, jk))], 1)

    def _lattice(self, side: int) -> Tensor:
        """The planes' values on a lattice, flat. (3, side * side, C)."""
        if side not in self._lattices:
            full = self._lattices[GRID_SIZE].view(3, side, 2, side, 2, self.channels)
            self._lattices[side] = full.sum((2, 4)).mul_(0.25).view(3, -1, self.channels)
        return self._lattices[side]


class Reader:
    """Reads sums over a few points of a field between its pixels, bilinearly.

    Of each point four pixels in each plane are read. A pixel's row in the table is affine in the point's lower pixel;
    its share is the product of one affine function of the position along rows and one along columns. For a group of
    points at a time these are products with block-diagonal matrices of a size that BLAS likes, and come out in the
    order that `embedding_bag` wants.

    Args:
        each: points whose features are summed.
        device: of all tensors.
    """

    def __init__(self, each: int, device: torch.device) -> None:
        self.group = GROUP if each == 1 else each
        index: list[Tensor] = []
        row: list[Tensor] = []
        column: list[Tensor] = []
        lengths = []
        for first in range(0, self.group, each):
            for planes in _PLANES:
                lengths.append(each * len(planes) * 4)
                for point in range(first, first + each):
                    for matrix, made in zip((index, row, column), _corners(planes), strict=True):
                        block = torch.zeros(self.group, 4, made.shape[1])
                        block[point] = made
                        matrix.append(block.flatten(0, 1))
        self._index, self._row, self._column = (torch.cat(m, 1).to(device) for m in (index, row, column))
        self._starts = torch.tensor([0, *lengths], device=device).cumsum(0)
        self._offsets = torch.empty(0, dtype=torch.int32, device=device)

    def read(self, field: Field, pixels: Tensor, weights: Tensor | None, buffers: Buffers) -> Tensor:
        """Weighted sums of features at pixels (M, 4), M a multiple of `group`, weights (M,). (M / each, 2 C)."""
        high = torch.clamp(pixels, 0.0, GRID_SIZE - 1.0, out=buffers.take("read.high", *pixels.shape))
        low = torch.floor(high, out=buffers.take("read.low", *pixels.shape)).clamp_(max=GRID_SIZE - 2.0)
        high.sub_(low)
        row = high
        if weights is not None:
            row = torch.mul(high, weights.view(-1, 1), out=buffers.take("read.row", *pixels.shape))
        groups = len(pixels) // self.group
        low, high, row = (x.view(groups, 4 * self.group) for x in (low, high, row))
        shape = (groups, self._index.shape[1])
        index = torch.mm(low, self._index, out=buffers.take("read.index", *shape)).to(torch.int32)
        factor = torch.mm(row, self._row, out=buffers.take("read.factor", *shape))
        factor.mul_(torch.mm(high, self._column, out=buffers.take("read.column", *shape)))
        offsets = self._bags(groups)
        sums = F.embedding_bag(index.view(-1), field.table, offsets, per_sample_weights=factor.view(-1), mode="sum")
        return sums.view(-1, 2 * field.channels)

    def _bags(self, groups: int) -> Tensor:
        """Where each sum begins, for that many groups. Two for each sum."""
        count = groups * (len(self._starts) - 1)
        if len(self._offsets) < count:
            size = torch.arange(groups, device=self._starts.device)[:, None] * self._starts[-1]
            self._offsets = (size + self._starts[:-1]).flatten().to(torch.int32)
        return self._offsets[:count]


def _corners(planes: tuple[int, ...]) -> tuple[Tensor, Tensor, Tensor]:
    """Of the four pixels in each plane: row of the table from the lower pixel, shares from what is above it. (4, N)."""
    n, one, half = GRID_SIZE, 3, 1.0 / (PIXEL_W - 1.0)
    entries = [(plane, up, right) for plane in planes for up in (0, 1) for right in (0, 1)]
    index, row, column = (torch.zeros(4, len(entries)) for _ in range(3))
    for e, (plane, up, right) in enumerate(entries):
        along_rows, along_columns = _AXES[plane]
        index[along_rows, e], index[along_columns, e] = n, 1
        index[one, e] = plane * n * n + up * n + right
        row[along_rows, e], row[one, e] = 2 * up - 1, half * (1 - up)
        column[along_columns, e], column[one, e] = 2 * right - 1, half * (1 - right)
    return index, row, column
