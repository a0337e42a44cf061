"""Tri-plane backbone: steerable U-Net on xy, a plain U-Net shared by the side views, joined by S2TP (spec §2.1).

Two wirings of the side branch, same parameters:

- `mixed`, as published: the raw regular channels of the xz and yz planes go through the side U-Net.
  A turn of the scene mixes the planes and mirrors them, which an ordinary U-Net does not follow.
- `exact`: the side U-Net sees four views, the volume turned by 0, 90, 180 and 270 degrees with its
  orientation channels rolled along. A turn of the scene only permutes the views, so whatever the
  U-Net computes, the four outputs read at a query form a regular field, and their mean an invariant.

In both, what leaves the side branch is a pair of planes whose sum at a query is the side feature:
for `exact` view 2 is view 0 from behind, so folding it (mirrored) onto view 0, and 3 onto 1, gives
the same number of planes and the same cost per query as the published form.
"""

from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from evg_app.nets.c4 import C4Linear, RegularConv2d, regular_bias
from evg_app.nets.features import Features
from evg_app.nets.fibres import ORDER, Fibre
from evg_app.nets.heads import RESIDUAL_START
from evg_app.nets.lift import LiftAndProject

Side = Literal["exact", "mixed"]
"""Wiring of the side branch."""


class SteerableBlock(nn.Module):
    """conv+ReLU -> r -> conv+ReLU -> conv -> +r -> ReLU on regular fields, 3x3."""

    def __init__(self, in_reg: int, out_reg: int) -> None:
        super().__init__()
        self.first = RegularConv2d(in_reg, out_reg)
        self.second = RegularConv2d(out_reg, out_reg)
        self.third = RegularConv2d(out_reg, out_reg)
        self.third.filter.scale_(RESIDUAL_START)

    def forward(self, x: Tensor) -> Tensor:
        """(B, 4 in, H, W) -> (B, 4 out, H, W)."""
        r = F.relu_(self.first(x))
        return F.relu_(self.third(F.relu_(self.second(r))) + r)


class PlainBlock(nn.Module):
    """Two times conv+ReLU, 3x3, ordinary channels."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.first = _he(nn.Conv2d(in_channels, out_channels, 3, padding=1))
        self.second = _he(nn.Conv2d(out_channels, out_channels, 3, padding=1))

    def forward(self, x: Tensor) -> Tensor:
        """(B, in, H, W) -> (B, out, H, W)."""
        return F.relu_(self.second(F.relu_(self.first(x))))


def _he(conv: nn.Conv2d | nn.ConvTranspose2d, gain: float = 2.0, fan: int | None = None) -> nn.Module:
    """He initialisation, zero bias."""
    fan = fan or conv.in_channels * conv.kernel_size[0] * conv.kernel_size[1]
    nn.init.normal_(conv.weight, std=(gain / fan) ** 0.5)
    assert conv.bias is not None
    nn.init.zeros_(conv.bias)
    return conv


class SideToPlane(nn.Module):
    """S2TP: the side planes' means over z join the xy field through an equivariant 1x1 map.

    f_xy <- Linear([f_xy, a]), a(x, y) = mean_z f_xz(x, .) + mean_z f_yz(y, .): no residual, no
    activation, as in the published code. As a is a sum of a function of x and one of y, its part of
    the map is done on lines, not on the plane.
    """

    def __init__(self, reg: int, channels: int) -> None:
        super().__init__()
        self.linear = C4Linear(Fibre(reg=reg, triv=channels), Fibre(reg=reg), bias=False)
        self.bias = regular_bias(reg)
        self.regular = ORDER * reg

    def forward(self, xy: Tensor, ax: Tensor, ay: Tensor) -> Tensor:
        """xy (B, 4 reg, X, Y), means ax (B, C, X) and ay (B, C, Y). (B, 4 reg, X, Y)."""
        matrix: Tensor = self.linear.matrix()
        regular, invariant = matrix[:, : self.regular], matrix[:, self.regular :]
        weight = regular[..., None, None].contiguous(memory_format=torch.channels_last)
        out: Tensor = F.conv2d(xy, weight, self.bias())
        along_x, along_y = invariant @ ax, invariant @ ay
        return out + along_x[..., None] + along_y[..., None, :]


class NoJoin(nn.Module):
    """In the place of `SideToPlane` in a network without S2TP."""

    def forward(self, xy: Tensor, ax: Tensor, ay: Tensor) -> Tensor:
        """xy as it is."""
        return xy


class JointTriUNet(nn.Module):
    """TSDF grid to tri-plane features (spec §2.1). 681,280 parameters with the published widths.

    Args:
        reg: regular copies at the three levels; the side branch has four times as many channels.
        side: wiring of the side branch.
        s2tp: whether the side planes join the xy field at every level.
    """

    def __init__(self, reg: tuple[int, ...] = (8, 16, 32), side: Side = "exact", s2tp: bool = True) -> None:
        super().__init__()
        if side not in ("exact", "mixed"):
            raise ValueError(f"side is {side!r}; allowed: exact, mixed")
        self.side: Side = side
        self.reg = reg
        channels = [ORDER * n for n in reg]
        down, up = list(range(len(reg))), list(range(len(reg) - 2, -1, -1))
        self.lift = LiftAndProject(reg[0])
        self.xy_down = nn.ModuleList(SteerableBlock(reg[max(i - 1, 0)], reg[i]) for i in down)
        self.side_down = nn.ModuleList(PlainBlock(channels[max(i - 1, 0)], channels[i]) for i in down)
        self.s2tp_down = nn.ModuleList(SideToPlane(reg[i], channels[i]) if s2tp else NoJoin() for i in down)
        self.xy_up = nn.ModuleList(RegularConv2d(reg[i + 1], reg[i], gain=1.0) for i in up)
        self.side_up = nn.ModuleList(
            _he(nn.ConvTranspose2d(channels[i + 1], channels[i], 2, 2), 1.0, channels[i + 1]) for i in up
        )
        self.xy_merge = nn.ModuleList(SteerableBlock(2 * reg[i], reg[i]) for i in up)
        self.side_merge = nn.ModuleList(PlainBlock(2 * channels[i], channels[i]) for i in up)
        self.s2tp_up = nn.ModuleList(SideToPlane(reg[i], channels[i]) if s2tp else NoJoin() for i in up)
        self.xy_out = RegularConv2d(reg[0], reg[0], kernel=1, gain=1.0)
        self.side_out = _he(nn.Conv2d(channels[0], channels[0], 1), 1.0)

    def forward(self, grid: Tensor) -> Features:
        """Encode TSDF grids (B, 1, N, N, N), axes (x, y, z), N divisible by 4."""
        xy, xz, yz = self.lift(grid)
        views = self._views(xz, yz).contiguous(memory_format=torch.channels_last)
        skips: list[tuple[Tensor, Tensor]] = []
        for level, (steer, plain, join) in enumerate(zip(self.xy_down, self.side_down, self.s2tp_down, strict=True)):
            if level:
                xy, views = F.avg_pool2d(xy, 2), F.max_pool2d(views, 2)
            xy, views = steer(xy), plain(views)
            xy = join(xy, *self._fold(views.mean(-1)))
            skips.append((xy, views))
        skips.pop()
        for i, join in enumerate(self.s2tp_up):
            xy_skip, side_skip = skips.pop()
            # align_corners=False: a pooled pixel sits in the middle of its four, as in avg_pool2d
            xy = self.xy_up[i](F.interpolate(xy, scale_factor=2, mode="bilinear", align_corners=False))
            xy = self.xy_merge[i](torch.cat([xy, xy_skip], 1))
            views = self.side_merge[i](torch.cat([self.side_up[i](views), side_skip], 1))
            xy = join(xy, *self._fold(views.mean(-1)))
        xz, yz = self._fold(self.side_out(views))
        return Features(torch.stack([plane.permute(0, 2, 3, 1) for plane in (self.xy_out(xy), xz, yz)]))

    def _views(self, xz: Tensor, yz: Tensor) -> Tensor:
        """Side views (V B, C, horizontal, z) of the lifted planes: 2 for `mixed`, 4 for `exact`."""
        if self.side == "mixed":
            return torch.cat([xz, yz])
        batch, _, *size = xz.shape
        fields = (batch, self.reg[0], ORDER, *size)
        seen = (xz, yz, xz.flip(2), yz.flip(2))
        return torch.cat([v.reshape(fields).roll(-k, 2).flatten(1, 2) for k, v in enumerate(seen)])

    def _fold(self, views: Tensor) -> tuple[Tensor, Tensor]:
        """Functions of (x, ...) and (y, ...) that sum to the side feature, from the views (V B, C, horizontal, ...)."""
        if self.side == "mixed":
            first, second = views.chunk(2)
            return first, second
        v0, v1, v2, v3 = views.chunk(ORDER)
        return 0.5 * (v0 + v2.flip(2)), 0.5 * (v1 + v3.flip(2))
