"""Tri-plane features and how they are read at query points.

Query points are p_norm = p_task / 0.3 m - 0.5, in [-0.5, 0.5], centred on the workspace (spec §1).
Voxel i has its centre at -0.5 + (i + 0.5) / 40 and is read exactly there (align_corners=False);
the published code maps -0.5 and 0.5 to the centres of pixels 0 and 39, up to half a voxel
(3.75 mm) off. Both are symmetric about the centre. Points outside read the border.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

_AXES = ((0, 1), (0, 2), (1, 2))
"""Coordinates (row, column) that read the xy, xz and yz plane."""


@dataclass(frozen=True)
class Features:
    """Encoded scenes. Opaque: read it with `sample`; index it by scene (int, slice or index tensor).

    Attributes:
        planes: (3, B, C, N, N), planes xy (regular channels; rows x, columns y), xz and yz
            (side channels; rows x or y, columns z; their sum at a point is invariant).
    """

    planes: Tensor

    @property
    def batch(self) -> int:
        """Number of scenes."""
        return self.planes.shape[1]

    def __getitem__(self, scenes: int | slice | Tensor) -> "Features":
        """The features of some of the scenes, always with a batch axis."""
        return Features(self.planes[:, [scenes]] if isinstance(scenes, int) else self.planes[:, scenes])

    def detach(self) -> "Features":
        """The same features without gradient."""
        return Features(self.planes.detach())


def sample(features: Features, points: Tensor) -> Tensor:
    """Features c(p) = [xy, xz + yz] at points (B, Q, 3). (B, Q, 2 C)."""
    if features.planes.shape[1] != points.shape[0]:
        raise ValueError(f"{points.shape[0]} sets of points for {features.planes.shape[1]} encoded scenes")
    if not torch.is_grad_enabled():
        return _sample_bag(features, points[:, :, None], None)
    planes = features.planes
    _, batch, channels, n, _ = planes.shape
    scaled = 2.0 * points
    grid = torch.stack([scaled[..., [column, row]] for row, column in _AXES])
    read = F.grid_sample(
        planes.reshape(3 * batch, channels, n, n),
        grid.reshape(3 * batch, 1, -1, 2),
        mode="bilinear",
        padding_mode="border",
        align_corners=False,
    ).view(3, batch, channels, -1)
    return torch.cat([read[0], read[1] + read[2]], 1).transpose(1, 2)


def sample_weighted(features: Features, points: Tensor, weights: Tensor) -> Tensor:
    """Weighted sum over K of the features at points (B, Q, K, 3), weights (B, Q, K). (B, Q, 2 C)."""
    if not torch.is_grad_enabled():
        return _sample_bag(features, points, weights)
    batch, queries, k, _ = points.shape
    read = sample(features, points.reshape(batch, queries * k, 3)).reshape(batch, queries, k, -1)
    return (weights[..., None, :] @ read).squeeze(-2)


def _sample_bag(features: Features, points: Tensor, weights: Tensor | None) -> Tensor:
    """`sample_weighted` as one gather of channel rows: 2-10 times faster, but slower than grid_sample to differentiate."""
    planes = features.planes
    _, batch, channels, n, _ = planes.shape
    table = planes.permute(0, 1, 3, 4, 2).reshape(-1, channels)
    pixel = ((points + 0.5) * n - 0.5).clamp_(0, n - 1)
    low = pixel.floor().clamp_(max=n - 2)
    high_part = pixel - low
    low_index = low.long()
    parts = torch.stack([1.0 - high_part, high_part])
    scene = torch.arange(batch, device=points.device).view(batch, 1, 1)
    corners = torch.tensor([0, 1, n, n + 1], device=points.device)
    indices, factors = [], []
    for plane, (row, column) in enumerate(_AXES):
        first = low_index[..., row] * n + low_index[..., column] + (plane * batch + scene) * n * n
        indices.append(first[..., None] + corners)
        product = parts[:, None, ..., row] * parts[None, :, ..., column]
        factors.append(product.flatten(0, 1).movedim(0, -1))
    if weights is not None:
        factors = [factor * weights[..., None] for factor in factors]
    queries = points.shape[1]
    xy = _bag(table, indices[0], factors[0])
    side = _bag(table, torch.cat(indices[1:], -1), torch.cat(factors[1:], -1))
    return torch.cat([xy, side], -1).view(batch, queries, -1)


def _bag(table: Tensor, index: Tensor, factor: Tensor) -> Tensor:
    """Rows of `table` summed with factors over the last two axes of index (B, Q, K, n). (B Q, C)."""
    flat = (index.shape[0] * index.shape[1], -1)
    return F.embedding_bag(index.reshape(flat), table, per_sample_weights=factor.reshape(flat), mode="sum")
