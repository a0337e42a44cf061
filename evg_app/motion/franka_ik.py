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
    u = (np.array([0.0, 0.0, geometry.d1]) - wrist)[:, None]
    # Everything up to the forearm is written in frame 6, where z5 = (s6, c6, 0). Shapes (M, q4, q6).
    ux, uy, uz = (u @ axes6)[:, 0].T[:, :, None, None]
    q4 = _elbow(geometry, np.einsum("mki,mki->m", u, u))[:, :, None]
    c4, s4 = np.cos(q4), np.sin(q4)
    along = geometry.a4 * s4 - geometry.d3 * c4 - geometry.d5
    across = geometry.a4 - geometry.a4 * c4 - geometry.d3 * s4
    across = np.where(np.abs(across) > _EPS, across, np.nan)
    q6 = np.arctan2(ux, uy) + _angle(along / np.maximum(np.hypot(ux, uy), _EPS)) * [1.0, -1.0]
    c6, s6 = np.cos(q6), np.sin(q6)
    x4 = (ux - along * s6) / across, (uy - along * c6) / across, uz / across
    q5 = np.arctan2(x4[2], c6 * x4[0] - s6 * x4[1])
    in_frame_6 = np.empty((len(q7), 2, 2, 2, 3))
    for k, z5 in enumerate((s6, c6, 0.0)):
        in_frame_6[:, 0, ..., k] = x4[k] * c4 - z5 * s4
        in_frame_6[:, 1, ..., k] = x4[k] * s4 + z5 * c4
    x3, z3 = (in_frame_6.reshape(len(q7), 8, 3) @ axes6.swapaxes(1, 2)).reshape(in_frame_6.shape).swapaxes(0, 1)
    q1, q2, q3 = _shoulder(x3, z3)
    q = np.empty((len(q7), 2, 2, 2, 7))
    for joint, value in ((3, q4), (4, q5), (5, q6), (6, q7[:, None, None])):
        q[..., joint] = value[..., None]
    q[..., 0], q[..., 2] = q1[..., None] + [0.0, np.pi], q3[..., None] + [0.0, np.pi]
    q[..., 1] = q2[..., None] * [1.0, -1.0]
    return q.reshape(len(q7), BRANCHES, 7)


def _joint6(geometry: FrankaGeometry, T_base_7: Array, q7: Array) -> tuple[Array, Array]:
    """Axes of frame 6 as columns (M, 3, 3), and the wrist centre (M, 3)."""
    c, s = np.cos(q7)[:, None], np.sin(q7)[:, None]
    x7, y7, z7 = (T_base_7[:, :3, k] for k in range(3))
    x6, z6 = x7 * c - y7 * s, x7 * s + y7 * c
    return np.stack([x6, -z7, z6], axis=2), T_base_7[:, :3, 3] - geometry.a7 * x6


def _angle(cosine: Array) -> Array:
    """The angle in [0, pi], NaN where there is none."""
    return np.asarray(np.arccos(np.where(np.abs(cosine) <= 1.0, cosine, np.nan)))


def _elbow(geometry: FrankaGeometry, square: Array) -> Array:
    """Both q4 for squared distances (M,) of shoulder and wrist; NaN when out of reach. Shape (M, 2)."""
    d3, a4, d5 = geometry.d3, geometry.a4, geometry.d5
    A, B = a4 * a4 - d3 * d5, a4 * (d3 + d5)
    C = (2 * a4 * a4 + d3 * d3 + d5 * d5 - square) / 2
    spread, middle = _angle(C / np.hypot(A, B)), np.arctan2(B, A)
    return np.stack([middle + spread - 2 * np.pi, middle - spread], axis=1)


def _shoulder(x3: Array, z3: Array) -> tuple[Array, Array, Array]:
    """q1, q2, q3 with q2 >= 0 from axes of frame 3 (..., 3); the other solution is (q1 + pi, -q2, q3 + pi). (...)."""
    q1 = np.arctan2(z3[..., 1], z3[..., 0])
    c1, s1 = np.cos(q1), np.sin(q1)
    c2 = np.clip(z3[..., 2], -1.0, 1.0)
    q2 = np.arccos(c2)
    ahead, up = c1 * x3[..., 0] + s1 * x3[..., 1], x3[..., 2]
    return q1, q2, np.arctan2(c1 * x3[..., 1] - s1 * x3[..., 0], c2 * ahead - np.sin(q2) * up)
