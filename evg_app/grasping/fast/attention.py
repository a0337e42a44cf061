"""The networks' two attentions with all maps around them multiplied out (`nets.attention` says what they compute)."""

import math

import torch
from torch import Tensor

from evg_app.geometry import GRID_SIZE
from evg_app.grasping.fast.field import GROUP, PIXEL_W, Field, Reader
from evg_app.grasping.fast.layers import Affine, Buffers
from evg_app.nets.attention import DeformableAttention, GraspAttention

CANDIDATES = 64
"""Grasps whose control points are read at a time: what they read fits the second-level cache."""


class Look:
    """A deformable attention up to what it reads: sum_k A_k c(p + D_k), offsets and weights linear in c(p)."""

    def __init__(self, attention: DeformableAttention, reader: Reader, device: torch.device) -> None:
        offsets, weights = Affine.of(attention.to_offsets), Affine.of(attention.to_weights)
        columns = [(attention.offsets + 2 * k, attention.offsets + 2 * k + 1, k) for k in range(attention.offsets)]
        matrix = offsets.weight.new_zeros(len(offsets.weight), attention.offsets, 4)
        bias = offsets.bias.new_zeros(attention.offsets, 4)
        for k, column in enumerate(columns):  # (x, y, z) of offset k among the outputs: z of all, then x and y of each
            matrix[:, k, :3], bias[k, :3] = (
                offsets.weight[:, column] * GRID_SIZE,
                offsets.bias[list(column)] * GRID_SIZE,
            )
        self._ask = Affine(matrix.flatten(1), bias.flatten()).beside(weights).final(device)
        self._reader, self._each = reader, attention.offsets
        self.attended = _attended(attention, weights)
        """From [c, what was read], side by side, to what the attention returns."""

    def __call__(self, field: Field, c: Tensor, pixels: Tensor, buffers: Buffers) -> Tensor:
        """[c, what was read] at points with features c (N, C) and pixels (N, 4). (N, 2 C)."""
        rows, split = len(c), 4 * self._each
        asked = self._ask(c, buffers.take("look.ask", rows, split + self._each))
        where = torch.add(
            asked[:, :split].view(rows, self._each, 4),
            pixels[:, None],
            out=buffers.take("look.where", rows, self._each, 4),
        )
        read = self._reader.read(field, where.view(-1, 4), asked[:, split:].reshape(-1), buffers)
        return torch.cat([c, read], 1)


def _attended(attention: DeformableAttention, weights: Affine) -> Affine:
    """c + out(to_values(read) + sum of weights * bias), all linear in [c, read]."""
    values, out = Affine.of(attention.to_values), Affine.of(attention.out)
    per_weight = values.bias @ out.weight
    own = torch.eye(len(weights.weight), dtype=torch.float64) + torch.outer(weights.weight.sum(1), per_weight)
    of_c = Affine(own, weights.bias.sum() * per_weight + out.bias)
    return of_c.plus(Affine(values.weight @ out.weight, torch.zeros_like(out.bias)))


class Grip:
    """The grasp-conditioned attention up to what it reads at the gripper's control points."""

    def __init__(self, attention: GraspAttention, reader: Reader, device: torch.device) -> None:
        points, code = (x.detach().double() for x in attention.tied())
        hidden = attention.hidden
        ask = Affine.of(attention.to_query)
        invariant = slice(4 * hidden.reg, 4 * hidden.reg + hidden.triv)
        bias = ask.bias.clone()
        bias[invariant] += attention.query_encoding.detach().double()
        scale = 1.0 / math.sqrt(hidden.size)
        query = Affine(ask.weight * scale, bias * scale)
        keys = Affine.of(attention.to_key).weight.T  # their bias is the same for all points: softmax ignores it
        codes = code.new_zeros(hidden.size, len(points))
        codes[invariant] = code.T
        both = torch.cat([keys, codes], 1)
        self._query = query.then(Affine(both, both.new_zeros(both.shape[1]))).final(device)
        self._place = _placement(points).final(device)
        self._reader, self._points = reader, len(points)
        value = Affine.of(attention.to_value).then(Affine.of(attention.out))
        self.attended = Affine(torch.eye(len(ask.weight), dtype=torch.float64), value.bias * 0.0).plus(value)
        """From [c, what was read], side by side, to what the attention returns."""

    def __call__(self, field: Field, c: Tensor, pixels: Tensor, rotation: Tensor, buffers: Buffers) -> Tensor:
        """[c, what was read] of grasps with features c (N, C), pixels (N, 4) and rotations (N, 3, 3). (N, 2 C)."""
        rows, channels = c.shape
        where = torch.cat([rotation.flatten(1), pixels[:, :3]], 1)
        query = self._query(c, buffers.take("grip.query", rows, channels + self._points))
        out = torch.empty(rows, 2 * channels, device=c.device)
        out[:, :channels] = c
        for first in range(0, rows, CANDIDATES):
            part = slice(first, min(first + CANDIDATES, rows))
            read = self._read(field, where[part], buffers)
            scores = torch.baddbmm(query[part, channels:, None], read, query[part, :channels, None])  # (n, points, 1)
            out[part, channels:] = torch.bmm(scores.softmax(1).transpose(1, 2), read)[:, 0]
        return out

    def _read(self, field: Field, where: Tensor, buffers: Buffers) -> Tensor:
        """Features at the control points of grasps [rotation, pixel] (n, 12). (n, points, C)."""
        n = len(where)
        padded = -(-n // GROUP) * GROUP
        pixels = buffers.take("grip.pixels", padded, 4 * self._points)
        pixels[n:] = 0.0
        self._place(where, pixels[:n])
        return self._reader.read(field, pixels.view(-1, 4), None, buffers).view(padded, self._points, -1)[:n]


def _placement(points: Tensor) -> Affine:
    """From a grasp [rotation (9), pixel (3)] to the pixels of control points (P, 3). (12, 4 P)."""
    matrix, bias = points.new_zeros(12, len(points), 4), points.new_zeros(len(points), 4)
    for axis in range(3):
        matrix[3 * axis : 3 * axis + 3, :, axis] = GRID_SIZE * points.T
        matrix[9 + axis, :, axis] = 1.0
    bias[:, 3] = PIXEL_W
    return Affine(matrix.flatten(1), bias.flatten())
