"""Reading encoded planes fast: whole rows at lattice points, weighted sums of rows anywhere else.

Points here are pixels: (x, y, z, PIXEL_W) with x = 0 at the centre of voxel 0. The fourth makes affine maps linear.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
import torch.nn.functional as F
from onnx import TensorProto
from torch import Tensor

from evg_app.geometry import GRID_SIZE
from evg_app.grasping.fast.graph import Graph, Shape

PIXEL_W = 1.5
"""Fourth number of a pixel: its whole part is 1, what is left is 0.5."""
_AXES = ((0, 1), (0, 2), (1, 2))
"""Coordinates (row, column) that read the xy, xz and yz plane."""
_PLANES = ((0,), (1, 2))
"""Planes whose values are added: xy alone, both sides together."""


class Field:
    """The features of one scene, from planes as `Features.planes` of one scene, (3, 40, 40, C)."""

    def __init__(self, planes: Tensor) -> None:
        self.channels = planes.shape[-1]
        self.table = planes.reshape(-1, self.channels)
        self._tables = {GRID_SIZE: self.table}

    def lattice(self, side: int) -> Tensor:
        """The planes' values on a lattice of 40 (voxel centres) or 20 (block centres) points a side. (3 side^2, C)."""
        if side not in self._tables:
            p = self.table.view(3, GRID_SIZE, GRID_SIZE, self.channels)
            total = (p[:, ::2, ::2] + p[:, 1::2, ::2]) + (p[:, ::2, 1::2] + p[:, 1::2, 1::2])
            self._tables[side] = total.mul_(0.25).view(-1, self.channels)
        return self._tables[side]


@dataclass(frozen=True)
class Lattice:
    """Where each point of a lattice is, and where its features are in `Field.lattice`.

    Attributes:
        rows: of the xy, xz and yz plane. Shape (side^3, 3), int32.
        pixels: shape (side^3, 4).
    """

    rows: Tensor
    pixels: Tensor


@lru_cache(maxsize=4)
def lattice_of(side: int) -> Lattice:
    """The lattice of `side` points a side."""
    ijk = np.stack(np.unravel_index(np.arange(side**3), (side,) * 3), -1)
    rows = [plane * side * side + ijk[:, row] * side + ijk[:, column] for plane, (row, column) in enumerate(_AXES)]
    step = GRID_SIZE // side
    pixels = np.full((side**3, 4), PIXEL_W, dtype=np.float32)
    pixels[:, :3] = step * ijk + 0.5 * (step - 1)
    return Lattice(torch.from_numpy(np.stack(rows, -1).astype(np.int32)), torch.from_numpy(pixels))


def lattice_features(g: Graph, channels: int) -> str:
    """Features (N, 2 C) at lattice points, where reading between pixels is reading one, or a mean of whole ones.

    The graph gets the inputs of `lattice_inputs`: a `Field.lattice` and the points' rows in it.
    """
    three = g.add("Reshape", g.add("Gather", "table", "rows", axis=0), g.constant([-1, 3 * channels]))
    one, none = torch.eye(channels), torch.zeros(channels, channels)
    both = torch.cat([torch.cat([one, none], 1), torch.cat([none, one], 1), torch.cat([none, one], 1)])
    return g.add("MatMul", three, g.constant(both))


def lattice_inputs(channels: int) -> dict[str, Shape]:
    """Names and shapes of what `lattice_features` needs."""
    return {"table": ["r", channels], "rows": ["n", 3]}


class Reader:
    """Reads sums over a few points of a field between its pixels, bilinearly.

    Of each point four pixels in each plane are read. A pixel's row in the table is affine in the point's lower pixel;
    its share is the product of one affine function of the position along rows and one along columns. For a group of
    points at a time these are products with block-diagonal matrices of a size that BLAS likes, and come out in the
    order that `embedding_bag` wants.

    Args:
        each: points whose features are summed.
        group: points whose corners one row of a product holds, a multiple of `each`.
    """

    def __init__(self, each: int, group: int) -> None:
        self.group = group
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
        self._index, self._row, self._column = (torch.cat(m, 1) for m in (index, row, column))
        self._starts = torch.tensor([0, *lengths]).cumsum(0)
        self._offsets = torch.empty(0, dtype=torch.int32)

    def ask(self, g: Graph, pixels: str, weights: str | None) -> dict[str, tuple[str, Shape]]:
        """Graph results for `read`: at pixels (..., 4), as many as make whole groups, with weights (..., 1)."""
        high = g.add(
            "Clip",
            pixels,
            g.constant(np.full((), 0.0, np.float32)),
            g.constant(np.full((), GRID_SIZE - 1.0, np.float32)),
        )
        low = g.add("Min", g.add("Floor", high), g.constant(np.full((), GRID_SIZE - 2.0, np.float32)))
        high = g.add("Sub", high, low)
        row = high if weights is None else g.add("Mul", high, weights)
        shape = g.constant([-1, 4 * self.group])
        low, high, row = (g.add("Reshape", x, shape) for x in (low, high, row))
        index = g.add("Cast", g.add("MatMul", low, g.constant(self._index)), to=TensorProto.INT32)
        shares = [g.add("MatMul", x, g.constant(m)) for x, m in ((row, self._row), (high, self._column))]
        columns = self._index.shape[1]
        return {"index": (index, ["g", columns]), "factor": (g.add("Mul", *shares), ["g", columns])}

    def read(self, field: Field, index: Tensor, factor: Tensor) -> Tensor:
        """Weighted sums of features, from what `ask` gave out. (sums, 2 C)."""
        offsets = self._bags(len(index))
        sums = F.embedding_bag(index.view(-1), field.table, offsets, per_sample_weights=factor.view(-1), mode="sum")
        return sums.view(-1, 2 * field.channels)

    def _bags(self, groups: int) -> Tensor:
        """Where each sum begins, for that many groups. Two for each sum."""
        count = groups * (len(self._starts) - 1)
        if len(self._offsets) < count:
            self._offsets = (
                (torch.arange(groups)[:, None] * self._starts[-1] + self._starts[:-1]).flatten().to(torch.int32)
            )
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
