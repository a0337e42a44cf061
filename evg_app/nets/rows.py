"""Weighted sums of table rows with a fast gradient on CPUs.

`embedding_bag` does the forward pass several times faster than `grid_sample`, but its own gradient
with respect to the table is slow. That gradient is again a weighted sum of rows (of the outgoing
gradient, with index and bag exchanged), so it is done by a second `embedding_bag`.
"""

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor
from torch.autograd.function import once_differentiable


def weighted_rows(table: Tensor, index: Tensor, factor: Tensor) -> Tensor:
    """sum_k factor[..., k] * table[index[..., k]]. (V, C), int32 (..., K), (..., K) -> (..., C)."""
    flat = (index.shape[:-1].numel(), index.shape[-1])
    out: Tensor = _WeightedRows.apply(table, index.reshape(flat), factor.reshape(flat))  # type: ignore[no-untyped-call]
    return out.view(*index.shape[:-1], table.shape[1])


class _WeightedRows(torch.autograd.Function):
    """`weighted_rows` for index and factor (N, K)."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, index: Tensor, factor: Tensor) -> Tensor:
        ctx.save_for_backward(table, index, factor)
        return F.embedding_bag(index, table, per_sample_weights=factor, mode="sum")

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, outgoing: Tensor) -> tuple[Tensor | None, None, Tensor | None]:
        """Gradients of the inputs of `forward`."""
        table, index, factor = ctx.saved_tensors
        outgoing = outgoing.contiguous()
        wanted_table, _, wanted_factor = ctx.needs_input_grad
        return (
            _table_gradient(table.shape[0], index, factor, outgoing) if wanted_table else None,
            None,
            _factor_gradient(table, index, factor, outgoing) if wanted_factor else None,
        )


def _table_gradient(rows: int, index: Tensor, factor: Tensor, outgoing: Tensor) -> Tensor:
    """Per table row the sum of factor * outgoing over the entries that read it."""
    flat = index.reshape(-1)
    order = flat.sort().indices
    counts = flat.bincount(minlength=rows)
    starts = (counts.cumsum(0) - counts).to(torch.int32)
    bag_of = torch.arange(index.shape[0], dtype=torch.int32, device=index.device).repeat_interleave(index.shape[1])
    return F.embedding_bag(bag_of[order], outgoing, starts, per_sample_weights=factor.reshape(-1)[order], mode="sum")


def _factor_gradient(table: Tensor, index: Tensor, factor: Tensor, outgoing: Tensor) -> Tensor:
    """Dot product of each entry's row with its bag's outgoing gradient."""
    with torch.enable_grad():
        leaf = factor.detach().requires_grad_()
        out = F.embedding_bag(index, table.detach(), per_sample_weights=leaf, mode="sum")
    (gradient,) = torch.autograd.grad(out, leaf, outgoing)
    return gradient
