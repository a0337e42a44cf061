"""What the Panda hand sweeps along its approach, as convex hulls in the grasp frame, for labels."""

import numpy as np

from evg_app.geometry import Array
from evg_app.simulation.hand_hulls import PAD_HALF_WIDTH, PAD_Z, finger_points, hand_points


def swept(points: Array, distance: float) -> Array:
    """Points (2P, 3) whose hull is what `points` (P, 3) sweep over `distance` [m] up to here along the approach."""
    return np.concatenate([points, points - [0.0, 0.0, distance]])


def swept_bodies(distance: float) -> tuple[Array, Array, Array]:
    """Both open fingers and the hand, swept from `distance` [m] before the grasp to the grasp; grasp frame."""
    return (
        swept(finger_points(+1), distance),
        swept(finger_points(-1), distance),
        swept(hand_points(), distance),
    )


__all__ = ["PAD_HALF_WIDTH", "PAD_Z", "finger_points", "hand_points", "swept", "swept_bodies"]
