"""Closed-form inverse kinematics of Franka arms (Panda, FR3) for a given q7, vectorised.

The wrist centre W and the axes of joint 6 follow from the hand pose and q7; shoulder S, elbow E and W form a triangle
with two known sides (q4), the angle between forearm and S-W gives q6, and the upper arm's frame gives q5, q1, q2, q3.
Derived here from the arm's modified Denavit-Hartenberg table. Up to eight solutions: 2 (q4) x 2 (q6) x 2 (shoulder).
"""

from dataclasses import dataclass

import numpy as np

from evg_app.geometry import Array, invert

BRANCHES = 8
"""Solutions of one pose and q7: index = 4 * (q4 branch) + 2 * (q6 branch) + (shoulder branch)."""
_EPS = 1e-9


@dataclass(frozen=True)
class FrankaGeometry:
    """Lengths of the arm [m] and the hand's place on the last joint.

    Attributes:
        d1, d3, a4, d5, a7: Denavit-Hartenberg lengths (0.333, 0.316, 0.0825, 0.384, 0.088 for the Panda).
        T_7_hand: hand in the frame of joint 7. Shape (4, 4).
    """

    d1: float
    d3: float
    a4: float
    d5: float
    a7: float
    T_7_hand: Array

    def placements(self) -> Array:
        """Each joint's frame in its parent's at q = 0. Shape (7, 4, 4)."""
        quarter = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        turns = [np.eye(3), quarter.T, quarter, quarter, quarter.T, quarter, quarter]
        offsets = [
            (0, 0, self.d1),
            (0, 0, 0),
            (0, -self.d3, 0),
            (self.a4, 0, 0),
            (-self.a4, self.d5, 0),
            (0, 0, 0),
            (self.a7, 0, 0),
        ]
        T = np.tile(np.eye(4), (7, 1, 1))
        T[:, :3, :3], T[:, :3, 3] = turns, offsets
        return T


def solve(geometry: FrankaGeometry, T_base_hand: Array, q7: Array) -> Array:
    """Every solution for given q7, without regard to joint limits; NaN rows where there is none.

    Args:
        geometry: of the arm.
        T_base_hand: shape (M, 4, 4).
        q7: shape (M,) [rad].

    Returns:
        Shape (M, 8, 7) [rad], angles not wrapped.
    """
    T_base_7 = T_base_hand @ invert(geometry.T_7_hand)
    axes6, wrist = _joint6(geometry, T_base_7, q7)
    u = np.array([0.0, 0.0, geometry.d1]) - wrist
    q = np.full((len(q7), 2, 2, 2, 7), np.nan)
    q[..., 6] = q7[:, None, None, None]
    for i, q4 in enumerate(_elbow(geometry, u)):
        c4, s4 = np.cos(q4), np.sin(q4)
        along_forearm = geometry.a4 * s4 - geometry.d3 * c4 - geometry.d5
        across_forearm = geometry.a4 - geometry.a4 * c4 - geometry.d3 * s4
        for j, q6 in enumerate(_wrist(axes6, u, along_forearm)):
            q[:, i, j, :, 3] = q4[:, None]
            q[:, i, j, :, 5] = q6[:, None]
            z5 = axes6[:, :, 0] * np.sin(q6)[:, None] + axes6[:, :, 1] * np.cos(q6)[:, None]
            x4 = (u - along_forearm[:, None] * z5) / np.where(np.abs(across_forearm) > _EPS, across_forearm, np.nan)[
                :, None
            ]
            z4 = np.cross(x4, z5)
            x5 = axes6[:, :, 0] * np.cos(q6)[:, None] - axes6[:, :, 1] * np.sin(q6)[:, None]
            q[:, i, j, :, 4] = np.arctan2(-_dot(x5, z4), _dot(x5, x4))[:, None]
            _shoulder(q[:, i, j], x4, z5)
    return q.reshape(len(q7), BRANCHES, 7)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", a, b))


def _joint6(geometry: FrankaGeometry, T_base_7: Array, q7: Array) -> tuple[Array, Array]:
    """Axes of frame 6 as columns (M, 3, 3), and the wrist centre (M, 3)."""
    c, s = np.cos(q7)[:, None], np.sin(q7)[:, None]
    x6 = T_base_7[:, :3, 0] * c - T_base_7[:, :3, 1] * s
    y6 = -T_base_7[:, :3, 2]
    return np.stack([x6, y6, np.cross(x6, y6)], axis=2), T_base_7[:, :3, 3] - geometry.a7 * x6


def _elbow(geometry: FrankaGeometry, u: Array) -> tuple[Array, Array]:
    """Both q4 for the shoulder-wrist vector u (M, 3); NaN when out of reach."""
    d3, a4, d5 = geometry.d3, geometry.a4, geometry.d5
    A, B = a4 * a4 - d3 * d5, a4 * (d3 + d5)
    C = (2 * a4 * a4 + d3 * d3 + d5 * d5 - _dot(u, u)) / 2
    cosine = C / np.hypot(A, B)
    spread = np.arccos(np.where(np.abs(cosine) <= 1.0, cosine, np.nan))
    middle = np.arctan2(B, A)
    return middle + spread - 2 * np.pi, middle - spread


def _wrist(axes6: Array, u: Array, along: Array) -> tuple[Array, Array]:
    """Both q6 for which the forearm axis z5 has the component `along` (M,) on u (M, 3)."""
    ux, uy = _dot(u, axes6[:, :, 0]), _dot(u, axes6[:, :, 1])
    cosine = along / np.maximum(np.hypot(ux, uy), _EPS)
    spread = np.arccos(np.where(np.abs(cosine) <= 1.0, cosine, np.nan))
    middle = np.arctan2(ux, uy)
    return middle + spread, middle - spread


def _shoulder(q: Array, x4: Array, y4: Array) -> None:
    """Fill q1, q2, q3 of q (M, 2, 7), which already holds q4, from the axes of frame 4, each (M, 3)."""
    c4, s4 = np.cos(q[:, 0, 3])[:, None], np.sin(q[:, 0, 3])[:, None]
    x3, z3 = x4 * c4 - y4 * s4, x4 * s4 + y4 * c4
    for k, sign in enumerate((1.0, -1.0)):
        q2 = sign * np.arccos(np.clip(z3[:, 2], -1.0, 1.0))
        q1 = np.arctan2(sign * z3[:, 1], sign * z3[:, 0])
        c1, s1, c2, s2 = np.cos(q1), np.sin(q1), np.cos(q2), np.sin(q2)
        side = np.stack([-s1, c1, np.zeros_like(c1)], axis=1)
        front = np.stack([c1 * c2, s1 * c2, -s2], axis=1)
        q[:, k, 0], q[:, k, 1], q[:, k, 2] = q1, q2, np.arctan2(_dot(x3, side), _dot(x3, front))
