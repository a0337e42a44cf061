"""Flow matching of grasp rotations (spec §2.6): velocity head, Euler sampling, antipodal coupling.

Rotations are six numbers in row order (see `rotation`). Base noise is N(0, 1), the target velocity
r1 - r0 (spec items 0.5, 0.6).
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from evg_app.nets.c4 import C4Linear
from evg_app.nets.fibres import Fibre
from evg_app.nets.heads import ConditionedTrunk
from evg_app.nets.rotation import flip, from_rows, rows_to_vectors, to_rows, vectors_to_rows

ROTATION = Fibre(vec=3)
"""Type of a rotation in the order of irreps."""


class TimeEmbedding(nn.Module):
    """[sin, cos](t f_j), f_j = exp(-j ln(1e4) / 7), then an MLP d -> 2 d Mish -> d. (...) -> (..., d)."""

    frequencies: Tensor

    def __init__(self, dim: int = 16) -> None:
        super().__init__()
        half = dim // 2
        frequencies = torch.exp(-torch.arange(half) * (math.log(1e4) / (half - 1)))
        self.register_buffer("frequencies", frequencies, persistent=False)
        self.first, self.second = nn.Linear(dim, 2 * dim), nn.Linear(2 * dim, dim)

    def forward(self, t: Tensor) -> Tensor:
        """Embedding of times in [0, 1]."""
        angle = t[..., None] * self.frequencies
        out: Tensor = self.second(F.mish(self.first(torch.cat([angle.sin(), angle.cos()], -1))))
        return out


class RotationFlow(nn.Module):
    """Velocity of a rotation on its way from noise to a grasp, given the point's context.

    Args:
        source: type of the context.
        hidden: type of the hidden feature, regular copies and invariants.
        blocks: number of residual blocks.
        time_dim: size of the time embedding.
    """

    def __init__(self, source: Fibre, hidden: Fibre, blocks: int = 5, time_dim: int = 16) -> None:
        super().__init__()
        self.start = C4Linear(ROTATION, hidden)
        self.context = C4Linear(source, hidden)
        self.trunk = ConditionedTrunk(hidden, blocks)
        self.time = TimeEmbedding(time_dim)
        self.inject_time = nn.ModuleList(C4Linear(Fibre(triv=time_dim), hidden, bias=False) for _ in range(blocks))
        self.out = C4Linear(hidden, ROTATION)
        self.out.matrix.scale_(0.3)

    def prepare(self, c: Tensor) -> list[Tensor]:
        """What the context adds to each block; does not depend on rotation or time."""
        return self.trunk.prepare(F.relu_(self.context(c)))

    def velocity(self, prepared: list[Tensor], rotation: Tensor, t: Tensor) -> Tensor:
        """Velocity (..., 6) in row order at rotation (..., 6) and time t (...), broadcast over points."""
        code = self.time(t)
        additions = [p + layer(code) for p, layer in zip(prepared, self.inject_time, strict=True)]
        net = self.trunk(additions, self.start(rows_to_vectors(rotation)))
        return vectors_to_rows(self.out(net))

    def forward(self, c: Tensor, rotation: Tensor, t: Tensor) -> Tensor:
        """Velocity (B, Q, 6) at rotation (B, Q, 6) and time t (B, Q), context c (B, Q, C)."""
        return self.velocity(self.prepare(c), rotation, t)

    def sample(self, c: Tensor, noise: Tensor, steps: int = 10) -> Tensor:
        """Rotations (B, Q, 3, 3) from noise (B, Q, 6) ~ N(0, 1) by `steps` Euler steps."""
        prepared, r = self.prepare(c), noise
        for step in range(steps):
            t = r.new_full((1,) * (r.ndim - 1), step / steps)
            r = r + self.velocity(prepared, r, t) / steps
        return from_rows(r)


def nearest_target(noise: Tensor, rotation: Tensor) -> Tensor:
    """Of the two antipodal targets of rotation (..., 3, 3) the one nearer to noise (..., 6), row order. (..., 6).

    With noise drawn once and each paired with its nearer target, the two modes of a grasp split the
    noise between them: minibatch optimal transport over the pair, without the rejection loop of the
    published code.
    """
    target, other = to_rows(rotation), to_rows(flip(rotation))
    nearer = (noise * target).sum(-1, keepdim=True) >= (noise * other).sum(-1, keepdim=True)
    return torch.where(nearer, target, other)
