"""The arm's links as capsules, for what moves relative to them: the held object."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import Array
from evg_app.motion.kinematics import Primitive

LAST_FRAME = 6
"""Frames beyond this move with the hand."""


@dataclass(frozen=True)
class LinkCapsules:
    """Capsules fixed to the frames of `Kinematics.frames`, without those that move with the hand.

    Attributes:
        frame: shape (C,).
        p0, p1: ends in that frame [m]. Shape (C, 3).
        radius: [m]. Shape (C,).
    """

    frame: NDArray[np.int64]
    p0: Array
    p1: Array
    radius: Array

    @staticmethod
    def of(bodies: list[Primitive]) -> "LinkCapsules":
        """From the arm's collision model."""
        kept = [body for body in bodies if body[1] <= LAST_FRAME]
        _, frame, p0, p1, radius = zip(*kept, strict=True)
        return LinkCapsules(np.array(frame), np.array(p0), np.array(p1), np.array(radius))

    def gap(self, frames: Array, points: Array) -> Array:
        """Distance [m] of points to the nearest capsule's surface. Shapes (N, 8, 4, 4), (N, S, 3) -> (N, S)."""
        T = frames[:, self.frame]
        a = (T[..., :3, :3] @ self.p0[:, :, None])[..., 0] + T[..., :3, 3]
        axis = (T[..., :3, :3] @ (self.p1 - self.p0)[:, :, None])[..., 0]
        square = np.maximum(((self.p1 - self.p0) ** 2).sum(axis=1), 1e-12)
        relative = points[:, :, None] - a[:, None]
        along = np.clip(np.einsum("nsci,nci->nsc", relative, axis) / square, 0.0, 1.0)
        relative -= along[..., None] * axis[:, None]
        distance: Array = np.sqrt(np.einsum("nsci,nsci->nsc", relative, relative)) - self.radius
        return np.asarray(distance.min(axis=2))
