"""Where the table is, from points of it that the finger tips touched."""

from dataclasses import dataclass

import numpy as np

from evg_app.errors import Refused
from evg_app.geometry import TABLE_HEIGHT, WORKSPACE_SIZE, Array

MIN_POINTS = 4
"""Fewer touches leave no residual to judge by."""
MIN_SPAN = 0.15
"""The touches must span this much along x and along y [m]."""
MAX_TILT_DEG = 1.0
"""The workspace's axes are those of the base, so the table must be this level with it [deg]."""
MAX_RESIDUAL = 0.003
"""The touches may lie this far from their plane [m]."""


@dataclass(frozen=True)
class TouchedTable:
    """The table's plane and the workspace on it.

    Attributes:
        origin: lower corner of the workspace cube in the base frame: T_base_task has this translation and no
            rotation. Shape (3,) [m].
        height: of the table top at the workspace's middle [m].
        tilt_deg: between the table and the base's xy-plane [deg].
        residual: largest distance of a touch from the plane [m].
    """

    origin: Array
    height: float
    tilt_deg: float
    residual: float


def touched_table(points: Array) -> TouchedTable:
    """The workspace whose middle is the middle of the touched points (N, 3), in the base frame [m].

    Raises:
        Refused: too few or too close touches, a tilted table, or touches that lie in no plane.
    """
    if len(points) < MIN_POINTS:
        raise Refused(f"{len(points)} touches, needed are {MIN_POINTS}. Touch the four corners of the square")
    span = np.ptp(points[:, :2], axis=0)
    if span.min() < MIN_SPAN:
        raise Refused(
            f"the touches span {span[0]:.3f} x {span[1]:.3f} m, needed are {MIN_SPAN} m each way. "
            "Touch the four corners of the square"
        )
    middle = (points[:, :2].min(axis=0) + points[:, :2].max(axis=0)) / 2
    A = np.column_stack([points[:, :2] - middle, np.ones(len(points))])
    (a, b, height), *_ = np.linalg.lstsq(A, points[:, 2], rcond=None)
    residual = float(np.abs(A @ np.array([a, b, height]) - points[:, 2]).max())
    tilt = float(np.rad2deg(np.arctan(np.hypot(a, b))))
    if residual > MAX_RESIDUAL:
        raise Refused(
            f"one touch lies {residual * 1e3:.1f} mm off the plane of all (allowed {MAX_RESIDUAL * 1e3:.0f} mm). "
            "Close the fingers, touch with their tips only, and measure again"
        )
    if tilt > MAX_TILT_DEG:
        raise Refused(
            f"the table is tilted by {tilt:.1f} degrees against the robot's base (allowed {MAX_TILT_DEG:g}). "
            "Level the table or the base, and measure again"
        )
    corner = middle - WORKSPACE_SIZE / 2
    return TouchedTable(np.array([*corner, height - TABLE_HEIGHT]), float(height), tilt, residual)
