"""Tri-plane features and how they are read at query points.

Query points are p_norm = p_task / 0.3 m - 0.5, in [-0.5, 0.5], centred on the workspace (spec §1).
Voxel i has its centre at -0.5 + (i + 0.5) / 40 and is read exactly there (align_corners=False);
the published code maps -0.5 and 0.5 to the centres of pixels 0 and 39, up to half a voxel
(3.75 mm) off. Both are symmetric about the centre. Points outside read the border.

Reading is bilinear, the same as grid_sample, but as a weighted sum of rows (`rows.weighted_rows`).
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from evg_app.nets.rows import weighted_rows

_AXES = ((0, 1), (0, 2), (1, 2))
"""Coordinates (row, column) that read the xy, xz and yz plane."""


@dataclass(frozen=True)
class Features:
    """Encoded scenes. Opaque: read it with `sample`; index it by scene (int, slice or index tensor).

    Attributes:
        planes: (3, B, N, N, C), planes xy (regular channels; rows x, columns y), xz and yz
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
    return sample_weighted(features, points[:, :, None], None)


def sample_weighted(features: Features, points: Tensor, weights: Tensor | None) -> Tensor:
    """Weighted sum over K of the features at points (B, Q, K, 3); weights (B, Q, K), None for ones. (B, Q, 2 C).

    Raises:
        ValueError: points are not one set per encoded scene.
    """
    _, batch, n, _, channels = features.planes.shape
    if points.ndim != 4 or points.shape[0] != batch or points.shape[-1] != 3:
        raise ValueError(f"points have shape {tuple(points.shape)}; expected ({batch}, Q, K, 3), one set per scene")
    # axes first, corners second: every elementwise step runs over long rows
    pixel = ((points.movedim(-1, 0).contiguous() + 0.5) * n - 0.5).clamp(0, n - 1)
    low = pixel.detach().floor().clamp_(max=n - 2)
    high_part = pixel - low
    parts = torch.stack([1.0 - high_part, high_part], 1)
    weighted = parts if weights is None else parts[:2] * weights
    index = low.int()
    scene = torch.arange(batch, device=points.device, dtype=torch.int32).view(batch, 1, 1) * (n * n)
    corners = torch.tensor([0, 1, n, n + 1], device=points.device, dtype=torch.int32).view(4, 1, 1, 1)
    indices, factors = [], []
    for plane, (row, column) in enumerate(_AXES):
        first = index[row] * n + index[column] + (scene + plane * batch * n * n)
        indices.append(first + corners)
        factors.append((weighted[row][:, None] * parts[column][None]).flatten(0, 1))
    table = features.planes.reshape(-1, channels)
    xy = weighted_rows(table, _per_query(indices[:1]), _per_query(factors[:1]))
    side = weighted_rows(table, _per_query(indices[1:]), _per_query(factors[1:]))
    return torch.cat([xy, side], -1)


def _per_query(corners: list[Tensor]) -> Tensor:
    """Planes of corners (4, B, Q, K) to (B, Q, 4 K planes)."""
    return torch.cat(corners).permute(1, 2, 3, 0).flatten(2)
