"""Rotations as six numbers: the first two rows of R (spec §2.3).

Row order (c1, c2, c3, s1, s2, s3) with c_j = R[0, j], s_j = R[1, j]; in the order of irreps the
same numbers read (c1, s1, c2, s2, c3, s3): three planar vectors that turn with the scene.
"""

import torch
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


def from_rows(rows: Tensor, eps: float = 1e-12) -> Tensor:
    """Nearest rotation to six numbers in row order (polar factor of the 2x3 block). (..., 6) -> (..., 3, 3).

    For A = [r1; r2]: rows (A A^T)^(-1/2) A in closed form, third row r1 x r2. Unlike row-wise
    Gram-Schmidt this commutes with turns of the scene, A -> G A (spec item 0.4). For the 2x2 matrix
    M = A A^T with s = sqrt(det M) and t = sqrt(tr M + 2 s): M^(-1/2) = adj(M + s I) / (s t).

    Args:
        rows: any six numbers; parallel rows have no nearest rotation and give a finite, not orthonormal result.
        eps: floor of det M relative to (tr M)^2, keeps values and gradients finite.
    """
    r1, r2 = rows[..., :3], rows[..., 3:]
    m11, m12, m22 = (r1 * r1).sum(-1), (r1 * r2).sum(-1), (r2 * r2).sum(-1)
    trace = m11 + m22
    normal = torch.linalg.cross(r1, r2)
    s = ((normal * normal).sum(-1) + eps * trace**2 + 1e-30).sqrt()
    t = (trace + 2.0 * s).sqrt()
    scale = (1.0 / (s * t))[..., None]
    row1 = ((m22 + s)[..., None] * r1 - m12[..., None] * r2) * scale
    row2 = ((m11 + s)[..., None] * r2 - m12[..., None] * r1) * scale
    return torch.stack([row1, row2, torch.linalg.cross(row1, row2)], -2)


def flip(rotation: Tensor) -> Tensor:
    """The antipodal twin R Rz(pi): the same grasp with the fingers exchanged. (..., 3, 3)."""
    return rotation * rotation.new_tensor([-1.0, -1.0, 1.0])


def turn_scene(points: Tensor, turns: int) -> Tensor:
    """Points or vectors (..., 3) after the scene has turned by `turns` * 90 degrees about z: (x, y) -> (-y, x)."""
    for _ in range(turns % 4):
        points = torch.stack([-points[..., 1], points[..., 0], points[..., 2]], -1)
    return points
