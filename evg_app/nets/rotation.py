"""Rotations as six numbers: the first two rows of R (spec §2.3).

Row order (c1, c2, c3, s1, s2, s3) with c_j = R[0, j], s_j = R[1, j]; in the order of irreps the
same numbers read (c1, s1, c2, s2, c3, s3): three planar vectors that turn with the scene.
"""

import torch
import torch.nn.functional as F
from torch import Tensor


def rows_to_vectors(rows: Tensor) -> Tensor:
    """Row order to the order of irreps. (..., 6) -> (..., 6)."""
    return rows.reshape(*rows.shape[:-1], 2, 3).transpose(-1, -2).flatten(-2)


def vectors_to_rows(vectors: Tensor) -> Tensor:
    """Order of irreps to row order. (..., 6) -> (..., 6)."""
    return vectors.reshape(*vectors.shape[:-1], 3, 2).transpose(-1, -2).flatten(-2)


def to_rows(rotation: Tensor) -> Tensor:
    """First two rows of rotations (..., 3, 3), in row order. (..., 6)."""
    return rotation[..., :2, :].flatten(-2)


def from_rows(rows: Tensor, eps: float = 1e-10) -> Tensor:
    """Nearest rotation to six numbers in row order (polar factor of the 2x3 block). (..., 6) -> (..., 3, 3).

    With n the unit normal of the rows r1, r2, the polar factor (A A^T)^(-1/2) A has the rows
    e1 = (r1 + r2 x n) / |r1 + r2 x n| and e2 = n x e1: as the inverse square root of the 2x2 matrix
    A A^T, but without its cancellations. Unlike row-wise Gram-Schmidt this commutes with turns of
    the scene, A -> G A (spec item 0.4).

    Args:
        rows: any six numbers; parallel rows have no nearest rotation and give a finite, not orthonormal result.
        eps: floor of the lengths divided by, keeps values and gradients finite.
    """
    r1, r2 = rows[..., :3], rows[..., 3:]
    normal = F.normalize(torch.linalg.cross(r1, r2), dim=-1, eps=eps)
    e1 = F.normalize(r1 + torch.linalg.cross(r2, normal), dim=-1, eps=eps)
    e2 = torch.linalg.cross(normal, e1)
    return torch.stack([e1, e2, torch.linalg.cross(e1, e2)], -2)


def flip(rotation: Tensor) -> Tensor:
    """The antipodal twin R Rz(pi): the same grasp with the fingers exchanged. (..., 3, 3)."""
    return rotation * rotation.new_tensor([-1.0, -1.0, 1.0])


def turn_scene(points: Tensor, turns: int) -> Tensor:
    """Points or vectors (..., 3) after the scene has turned by `turns` * 90 degrees about z: (x, y) -> (-y, x)."""
    for _ in range(turns % 4):
        points = torch.stack([-points[..., 1], points[..., 0], points[..., 2]], -1)
    return points
