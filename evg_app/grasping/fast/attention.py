"""The networks' two attentions as parts of graphs, all maps around them multiplied out (`nets.attention` says what they
compute). Between a part that asks and one that goes on, a `Reader` reads the field."""

import math

import torch
from torch import Tensor

from evg_app.geometry import GRID_SIZE
from evg_app.grasping.fast.affine import Affine
from evg_app.grasping.fast.field import PIXEL_W, Reader
from evg_app.grasping.fast.graph import Graph, Shape
from evg_app.nets.attention import DeformableAttention, GraspAttention

Results = dict[str, tuple[str, Shape]]
"""What a graph gives out, see `Graph.model`."""
GRIP_GROUP = 5
"""Control points whose corners one row of a product holds: a divisor of their number."""


class Look:
    """A deformable attention up to what it reads: sum_k A_k c(p + D_k), offsets and weights linear in c(p).

    Attributes:
        reader: reads what `ask` asks for.
        attended: from [c, what was read], side by side, to what the attention returns.
    """

    def __init__(self, attention: DeformableAttention) -> None:
        self._weights, self._offsets = Affine.of(attention.to_weights), _pixel_offsets(attention)
        self.attended = _attended(attention, self._weights)
        self.reader = Reader(attention.offsets, attention.offsets)

    def ask(self, g: Graph, c: str, pixels: str) -> Results:
        """From features (N, C) and pixels (N, 4) to what the reader wants."""
        where = g.add("Reshape", g.affine(c, self._offsets), g.constant([-1, self.reader.group, 4]))
        where = g.add("Add", where, g.add("Unsqueeze", pixels, g.constant([1])))
        weight = g.add("Unsqueeze", g.affine(c, self._weights), g.constant([2]))
        return self.reader.ask(g, where, weight)


def _pixel_offsets(attention: DeformableAttention) -> Affine:
    """From c to the offsets as pixels (x, y, z, 0) of all attended points."""
    offsets, count = Affine.of(attention.to_offsets), attention.offsets
    matrix = offsets.weight.new_zeros(len(offsets.weight), count, 4)
    bias = offsets.bias.new_zeros(count, 4)
    for k in range(count):  # the outputs are z of all, then x and y of each
        columns = [count + 2 * k, count + 2 * k + 1, k]
        matrix[:, k, :3], bias[k, :3] = GRID_SIZE * offsets.weight[:, columns], GRID_SIZE * offsets.bias[columns]
    return Affine(matrix.flatten(1), bias.flatten())


def _attended(attention: DeformableAttention, weights: Affine) -> Affine:
    """c + out(to_values(read) + sum of weights * bias), all linear in [c, read]."""
    values, out = Affine.of(attention.to_values), Affine.of(attention.out)
    per_weight = values.bias @ out.weight
    own = torch.eye(len(weights.weight), dtype=torch.float64) + torch.outer(weights.weight.sum(1), per_weight)
    of_c = Affine(own, weights.bias.sum() * per_weight + out.bias)
    return of_c.plus(Affine.linear(values.weight @ out.weight))


class Grip:
    """The grasp-conditioned attention, before and after what it reads at the gripper's control points.

    Attributes:
        reader: reads what `ask` asks for.
        attended: from [c, mean of what was read], side by side, to what the attention returns.
    """

    def __init__(self, attention: GraspAttention) -> None:
        points, code = (x.detach().double().cpu() for x in attention.tied())
        self._points, self._placement = len(points), _placement(points)
        self._query = _query(attention, code)
        self.reader = Reader(1, GRIP_GROUP)
        value = Affine.of(attention.to_value).then(Affine.of(attention.out))
        self.attended = Affine.linear(torch.eye(len(self._query.weight))).plus(value)

    def ask(self, g: Graph, rotation: str, pixels: str, draws: int) -> Results:
        """From rotations (draws * N, 9) and pixels (N, 4) to what the reader wants."""
        centre = g.add("Slice", pixels, g.constant([0]), g.constant([3]), g.constant([1]))
        where = g.add("Concat", rotation, g.add("Concat", *[centre] * draws, axis=0), axis=1)
        return self.reader.ask(g, g.add("Reshape", g.affine(where, self._placement), g.constant([-1, 4])), None)

    def mean(self, g: Graph, c: str, read: str, draws: int) -> str:
        """[c, mean of what was read] (draws * N, 2 C), from c (N, C) and what was read at all control points."""
        channels = len(self._query.weight)
        query = g.affine(c, self._query)
        ask = g.add("Slice", query, g.constant([0]), g.constant([channels]), g.constant([1]))
        code = g.add("Slice", query, g.constant([channels]), g.constant([channels + self._points]), g.constant([1]))
        last = g.constant([2])
        ask, code = (
            g.add("Concat", *[g.add("Unsqueeze", x, last)] * draws, axis=0) for x in (ask, code)
        )  # (draws * N, C or points, 1)
        read = g.add("Reshape", read, g.constant([-1, self._points, channels]))
        share = g.add("Softmax", g.add("Add", g.add("MatMul", read, ask), code), axis=1)
        mean = g.add("MatMul", g.add("Transpose", share, perm=[0, 2, 1]), read)
        own = g.add("Concat", *[c] * draws, axis=0)
        return g.add("Concat", own, g.add("Reshape", mean, g.constant([-1, channels])), axis=1)


def _query(attention: GraspAttention, code: Tensor) -> Affine:
    """From c to what a point's feature is multiplied with, and what its encoding adds: (C, C + points)."""
    hidden, ask = attention.hidden, Affine.of(attention.to_query)
    invariant = slice(4 * hidden.reg, 4 * hidden.reg + hidden.triv)
    encoding = torch.zeros_like(ask.bias)
    encoding[invariant] = attention.query_encoding.detach().double().cpu()
    scale = 1.0 / math.sqrt(hidden.size)
    query = Affine(scale * ask.weight, scale * (ask.bias + encoding))
    codes = code.new_zeros(hidden.size, len(code))
    codes[invariant] = code.T
    keys = Affine.of(attention.to_key).weight.T  # their bias is the same for all points: softmax ignores it
    return query.then(Affine.linear(torch.cat([keys, codes], 1)))


def _placement(points: Tensor) -> Affine:
    """From a grasp [rotation (9), pixel (3)] to the pixels of control points (P, 3). (12, 4 P)."""
    matrix, bias = points.new_zeros(12, len(points), 4), points.new_zeros(len(points), 4)
    for axis in range(3):
        matrix[3 * axis : 3 * axis + 3, :, axis] = GRID_SIZE * points.T
        matrix[9 + axis, :, axis] = 1.0
    bias[:, 3] = PIXEL_W
    return Affine(matrix.flatten(1), bias.flatten())
