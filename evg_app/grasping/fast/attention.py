"""The networks' two attentions with all maps around them multiplied out (`nets.attention` says what they compute)."""

import math

import torch
from torch import Tensor

from evg_app.geometry import GRID_SIZE
from evg_app.grasping.fast.affine import Affine
from evg_app.grasping.fast.field import PIXEL_W, Field, Reader
from evg_app.grasping.fast.graph import Graph, Native, Shape
from evg_app.nets.attention import DeformableAttention, GraspAttention

CANDIDATES = 64
"""Grasps whose control points are read at a time: what they read fits the second-level cache."""


class Look:
    """A deformable attention up to what it reads: sum_k A_k c(p + D_k), offsets and weights linear in c(p).

    Attributes:
        attended: from [c, what was read], side by side, to what the attention returns.
    """

    def __init__(self, attention: DeformableAttention) -> None:
        weights = Affine.of(attention.to_weights)
        self.attended = _attended(attention, weights)
        self._reader = Reader(attention.offsets)
        self._ask = self._graph(attention, weights)

    def _graph(self, attention: DeformableAttention, weights: Affine) -> Native:
        """From features (N, C) and pixels (N, 4) to what the reader wants."""
        g, each = Graph(), attention.offsets
        offsets = g.affine("c", _pixel_offsets(attention))
        where = g.add("Reshape", offsets, g.constant([-1, each, 4]))
        where = g.add("Add", where, g.add("Unsqueeze", "pixels", g.constant([1])))
        weight = g.add("Unsqueeze", g.affine("c", weights), g.constant([2]))
        inputs: dict[str, Shape] = {"c": ["n", len(weights.weight)], "pixels": ["n", 4]}
        return Native(g.model(inputs, self._reader.ask(g, where, weight)))

    def __call__(self, field: Field, c: Tensor, pixels: Tensor) -> Tensor:
        """[c, what was read] at points with features c (N, C) and pixels (N, 4). (N, 2 C)."""
        return torch.cat([c, self._reader.read(field, *self._ask(c, pixels))], 1)


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
    """The grasp-conditioned attention up to what it reads at the gripper's control points.

    Attributes:
        attended: from [c, what was read], side by side, to what the attention returns.
    """

    def __init__(self, attention: GraspAttention) -> None:
        points, code = (x.detach().double().cpu() for x in attention.tied())
        self._points, self._reader = len(points), Reader(1)
        query = _query(attention, code)
        g = Graph()
        asked = g.affine("c", query)
        self._query = Native(g.model({"c": ["n", len(query.weight)]}, {"y": (asked, ["n", len(query.bias)])}))
        g = Graph()
        pixels = g.add("Reshape", g.affine("where", _placement(points)), g.constant([-1, 4]))
        self._place = Native(g.model({"where": ["n", 12]}, self._reader.ask(g, pixels, None)))
        value = Affine.of(attention.to_value).then(Affine.of(attention.out))
        self.attended = Affine.linear(torch.eye(len(query.weight))).plus(value)

    def __call__(self, field: Field, c: Tensor, pixels: Tensor, rotation: Tensor) -> Tensor:
        """[c, what was read] of grasps with features c (N, C), pixels (N, 4) and rotations (N, 3, 3). (N, 2 C)."""
        rows, channels = c.shape
        where = torch.cat([rotation.flatten(1), pixels[:, :3]], 1)
        query = self._query(c)[0]
        parts = []
        for first in range(0, rows, CANDIDATES):
            part = slice(first, min(first + CANDIDATES, rows))
            read = self._read(field, where[part])
            scores = torch.baddbmm(query[part, channels:, None], read, query[part, :channels, None])  # (n, points, 1)
            parts.append(torch.bmm(scores.softmax(1).transpose(1, 2), read)[:, 0])
        return torch.cat([c, torch.cat(parts)], 1)

    def _read(self, field: Field, where: Tensor) -> Tensor:
        """Features at the control points of grasps [rotation, pixel] (n, 12). (n, points, C)."""
        n = len(where)
        if n % self._reader.group:
            where = torch.cat([where, where.new_zeros(-n % self._reader.group, 12)])
        return self._reader.read(field, *self._place(where)).view(len(where), self._points, -1)[:n]


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
