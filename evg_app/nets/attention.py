"""Attention over the feature field: equivariant deformable (spec §2.4) and grasp-conditioned (spec §2.5).

Both use that linear maps commute with weighted sums: features are averaged first and mapped once
per query, not once per attended point. Same function, same parameters, a fraction of the work.
"""

import math

import torch
from torch import Tensor, nn

from evg_app.nets.c4 import C4Linear
from evg_app.nets.features import Features, sample, sample_weighted
from evg_app.nets.fibres import Fibre
from evg_app.nets.heads import CONTRAST

WORKSPACE_SIZE = 0.30
"""Side of the workspace [m]; control points are stored in units of it."""
OFFSET_START = 0.05
"""Typical offset at initialisation, in units of the workspace (1.5 cm)."""


class DeformableAttention(nn.Module):
    """EDA: c(p) + Linear_out(sum_k A_k Linear_in(c(p + D_k))), offsets and weights linear in c(p).

    Args:
        fibre: type of the point feature.
        offsets: number K of attended points.
        value_reg: regular copies of the value type.
    """

    def __init__(self, fibre: Fibre, offsets: int = 8, value_reg: int = 24) -> None:
        super().__init__()
        self.to_offsets = C4Linear(fibre, Fibre(triv=offsets, vec=offsets), contrast=CONTRAST)
        self.to_weights = C4Linear(fibre, Fibre(triv=offsets))
        self.to_values = C4Linear(fibre, Fibre(reg=value_reg))
        self.out = C4Linear(Fibre(reg=value_reg), fibre)
        self.offsets = offsets
        self.to_offsets.matrix.scale_(OFFSET_START)
        self.to_weights.matrix.scale_(offsets**-0.5)

    def forward(self, features: Features, points: Tensor, c: Tensor) -> Tensor:
        """Attended feature at points (B, Q, 3) with their own feature c (B, Q, C). (B, Q, C)."""
        z, xy = self.to_offsets(c).split([self.offsets, 2 * self.offsets], -1)
        delta = torch.cat([xy.reshape(*xy.shape[:-1], self.offsets, 2), z[..., None]], -1)
        weights: Tensor = self.to_weights(c)
        mixed = sample_weighted(features, points[:, :, None] + delta, weights)
        values = mixed @ self.to_values.matrix().T
        if self.to_values.bias is not None:
            values = values + weights.sum(-1, keepdim=True) * self.to_values.bias()
        out: Tensor = self.out(values)
        return c + out


class NoAttention(nn.Module):
    """In the place of `DeformableAttention` in a network without EDA."""

    def forward(self, features: Features, points: Tensor, c: Tensor) -> Tensor:
        """The points' own features c."""
        return c


def control_points() -> Tensor:
    """The 25 control points of the gripper in the grasp frame, x = 0, y outer, z inner [m]. (25, 3)."""
    y = torch.linspace(-0.04, 0.04, 5)
    z = torch.linspace(0.0, 0.05, 5)
    grid = torch.cartesian_prod(y, z)
    return torch.cat([torch.zeros(25, 1), grid], 1)


class GraspAttention(nn.Module):
    """Attention from a grasp's centre to 25 learnable control points that move with the grasp.

    As in the paper: scores divided by sqrt(d), no common offset. Encodings act on the invariant
    channels of query and key only, so that the result keeps its type (spec §2.5 tells how the
    published code breaks this).

    Args:
        fibre: type of the point feature.
        hidden: type of query, key and value.
        antipodal: tie points and encodings under the exchange of the fingers, so that R and
            R Rz(pi), which are one grasp, get one result (ours).
    """

    def __init__(self, fibre: Fibre, hidden: Fibre, antipodal: bool = True) -> None:
        super().__init__()
        self.to_query = C4Linear(fibre, hidden)
        self.to_key = C4Linear(fibre, hidden)
        self.to_value = C4Linear(fibre, hidden)
        self.out = C4Linear(hidden, fibre)
        self.out.matrix.scale_(0.5)
        self.points = nn.Parameter(control_points() / WORKSPACE_SIZE)
        self.query_encoding = nn.Parameter(torch.rand(hidden.triv))
        self.key_encoding = nn.Parameter(torch.rand(25, hidden.triv))
        self.hidden, self.antipodal = hidden, antipodal

    def tied(self) -> tuple[Tensor, Tensor]:
        """Control points (25, 3) and key encodings (25, triv), tied under the exchange of the fingers if wanted."""
        if not self.antipodal:
            return self.points, self.key_encoding
        points, code = self.points.view(5, 5, 3), self.key_encoding.view(5, 5, -1)
        turned = points.flip(0) * points.new_tensor([-1.0, -1.0, 1.0])
        return (0.5 * (points + turned)).view(25, 3), (0.5 * (code + code.flip(0))).view(25, -1)

    def forward(self, features: Features, points: Tensor, rotation: Tensor, c: Tensor) -> Tensor:
        """Feature (B, Q, C) of grasps at points (B, Q, 3), rotations (B, Q, 3, 3), point features c (B, Q, C)."""
        batch, queries, _ = points.shape
        local, code = self.tied()
        triv = slice(4 * self.hidden.reg, self.hidden.size)
        world = points[:, :, None] + local @ rotation.transpose(-1, -2)
        read = sample(features, world.reshape(batch, queries * 25, 3)).reshape(batch, queries, 25, -1)
        query = self.to_query(c)
        query = torch.cat([query[..., : triv.start], query[..., triv] + self.query_encoding], -1)
        query = query / math.sqrt(self.hidden.size)
        folded = query @ self.to_key.matrix()
        scores = (read @ folded[..., None]).squeeze(-1) + query[..., triv] @ code.T
        attention = scores.softmax(-1)
        mixed = (attention[..., None, :] @ read).squeeze(-2)
        out: Tensor = self.out(self.to_value(mixed))
        return c + out
