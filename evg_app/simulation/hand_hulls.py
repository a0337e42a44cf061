"""The Panda hand as convex hulls in the grasp frame: open fingers and hand, for labels and for physics.

Dimensions measured on example-robot-data's Panda (finger and hand collision meshes and pad boxes); finger link
frames lie at (0, +-0.04, -0.0036) of the grasp frame when open (spec §11 check 3).
"""

import itertools

import numpy as np

from evg_app.geometry import MAX_OPENING, Array

FINGER_FRAME_Z = -0.0036
"""Finger link frame along the approach, in the grasp frame [m]."""
HAND_FRAME_Z = -0.062
"""`panda_hand` along the approach, in the grasp frame [m]."""
PAD_HALF_WIDTH = 0.0085
"""Half extent of the rubber pad along the hand's thickness axis x [m]."""
PAD_Z = (0.0330, 0.0502)
"""Where the flat pad begins and ends along the approach, in the grasp frame [m]."""

_FINGER_SECTIONS = (
    (0.0000, 0.0025, 0.0265, 0.0110),
    (0.0200, 0.0004, 0.0260, 0.0110),
    (0.0360, 0.0000, 0.0190, 0.0088),
    (0.0510, 0.0000, 0.0152, 0.0088),
    (0.0540, 0.0000, 0.0145, 0.0060),
)
"""Height in the finger frame, inner and outer distance from the pad plane, half thickness [m]."""
_HAND_SECTIONS = ((-0.026, 0.104, 0.032), (0.013, 0.104, 0.032), (0.025, 0.101, 0.022), (0.066, 0.101, 0.022))
"""Height in the hand frame, half length along y, half thickness along x [m]."""


def finger_points(side: int, opening: float = MAX_OPENING) -> Array:
    """Corners of one finger's hull in the grasp frame [m]. `side` is +1 or -1 (of y). Shape (P, 3)."""
    corners = [
        (sign * half, side * (opening / 2 + y), z + FINGER_FRAME_Z)
        for z, inner, outer, half in _FINGER_SECTIONS
        for y, sign in itertools.product((inner, outer), (-1.0, 1.0))
    ]
    return np.array(corners)


def hand_points() -> Array:
    """Corners of the hand's hull in the grasp frame [m]. Shape (P, 3)."""
    corners = [
        (sx * half_x, sy * half_y, z + HAND_FRAME_Z)
        for z, half_y, half_x in _HAND_SECTIONS
        for sx, sy in itertools.product((-1.0, 1.0), (-1.0, 1.0))
    ]
    return np.array(corners)
