"""Lifting of the TSDF grid and its projection on three planes, as one memory-friendly step (spec §2.1).

The lifted volume (8 MB per scene) is only needed for its means, so it is made slab by slab, inside
the CPU's cache, and made again for the gradient: half the time of conv3d + ReLU + three means.
"""

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.autograd.function import once_differentiable
from torch.nn.grad import conv2d_weight

from evg_app.nets.c4 import lift_index, regular_bias
from evg_app.nets.expanded import ExpandedFilter

_SLICES = 8
"""z-slices per slab: 1.6 MB of lifted features at 32 channels."""


class LiftAndProject(nn.Module):
    """3D steerable convolution 1 -> regular copies (3x3x3, the group acting on x and y), ReLU, means along z, y, x."""

    def __init__(self, out_reg: int) -> None:
        super().__init__()
        index = lift_index(out_reg, 1, (3, 3, 3))
        self.filter = ExpandedFilter(out_reg * 27, index, None, (2.0 / 27) ** 0.5)
        self.bias = regular_bias(out_reg)

    def forward(self, grid: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """(B, 1, X, Y, Z) -> planes xy (B, C, X, Y), xz (B, C, X, Z), yz (B, C, Y, Z), channels last in memory."""
        if grid.ndim != 5 or grid.shape[1] != 1:
            raise ValueError(f"grid has shape {tuple(grid.shape)}; expected (B, 1, X, Y, Z)")
        if grid.is_cuda:
            return self._at_once(grid)
        weight = self.filter()[:, 0].permute(0, 3, 1, 2).contiguous(memory_format=torch.channels_last)
        xy, xz, yz = _LiftAndProject.apply(_slabs(grid), weight, self.bias())  # type: ignore[no-untyped-call]
        return xy.permute(0, 3, 1, 2), xz.permute(0, 3, 2, 1), yz.permute(0, 3, 2, 1)

    def _at_once(self, grid: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The same where memory is plenty and small steps are dear: on an accelerator."""
        lifted = F.relu_(F.conv3d(grid, self.filter(), self.bias(), padding=1))
        return lifted.mean(4), lifted.mean(3), lifted.mean(2)


def _slabs(grid: Tensor) -> Tensor:
    """(B, 1, X, Y, Z) -> (B, Z, 3, X, Y): each z-slice with its neighbours as channels, channels last in memory."""
    return F.pad(grid[:, 0], (1, 1)).unfold(3, 3, 1).permute(0, 3, 1, 2, 4).contiguous().permute(0, 1, 4, 2, 3)


def _lift(slab: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """(S, 3, X, Y) -> (S, X, Y, C), after ReLU."""
    return F.relu_(F.conv2d(slab, weight, bias, padding=1)).permute(0, 2, 3, 1)


class _LiftAndProject(torch.autograd.Function):
    """Means of the lifted volume over z (B, X, Y, C), y (B, Z, X, C) and x (B, Z, Y, C)."""

    @staticmethod
    def forward(ctx: Any, slabs: Tensor, weight: Tensor, bias: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Means of the lifted slabs, slab by slab; only the inputs are kept."""
        ctx.save_for_backward(slabs, weight, bias)
        batch, nz, _, nx, ny = slabs.shape
        channels = weight.shape[0]
        xy = slabs.new_zeros(batch, nx, ny, channels)
        xz = slabs.new_empty(batch, nz, nx, channels)
        yz = slabs.new_empty(batch, nz, ny, channels)
        for scene in range(batch):
            for start in range(0, nz, _SLICES):
                part = slice(start, start + _SLICES)
                lifted = _lift(slabs[scene, part], weight, bias)
                xy[scene] += lifted.sum(0)
                torch.mean(lifted, 2, out=xz[scene, part])
                torch.mean(lifted, 1, out=yz[scene, part])
        return xy.div_(nz), xz, yz

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, g_xy: Tensor, g_xz: Tensor, g_yz: Tensor) -> tuple[None, Tensor, Tensor]:
        """Gradients of weight and bias; each slab is lifted again."""
        slabs, weight, bias = ctx.saved_tensors
        batch, nz, _, nx, ny = slabs.shape
        g_weight, g_bias = torch.zeros_like(weight), torch.zeros_like(bias)
        g_xy, g_xz, g_yz = g_xy / nz, g_xz / ny, g_yz / nx
        for scene in range(batch):
            for start in range(0, nz, _SLICES):
                part = slice(start, start + _SLICES)
                slab = slabs[scene, part]
                lifted = _lift(slab, weight, bias)
                grad = (g_xy[scene] + g_xz[scene, part, :, None]).add_(g_yz[scene, part, None])
                grad.mul_(lifted.sign_())  # the ReLU gradient, without a mask of its own
                outgoing = grad.permute(0, 3, 1, 2)
                g_weight += conv2d_weight(slab, weight.shape, outgoing, padding=1)  # type: ignore[no-untyped-call]
                g_bias += grad.sum((0, 1, 2))
        return None, g_weight, g_bias
