"""Where the table is, from points of it: touched by the finger tips, or corners of a board that lies on it."""

from dataclasses import dataclass

import numpy as np

from evg_app.errors import Refused
from evg_app.geometry import TABLE_HEIGHT, WORKSPACE_SIZE, Array

MIN_POINTS = 4
"""Fewer touches leave no residual to judge by."""


@dataclass(frozen=True)
class Means:
    """By what points of the table were found, and how good they must be.

    Attributes:
        point: what one of them is called.
        min_span: they must span this much along x and along y [m].
        max_tilt_deg: the workspace's axes are those of the base, so the table must be this level with it [deg].
        max_residual: they may lie this far from their plane [m].
        advice: what to do about points that lie in no plane.
    """

    point: str
    min_span: float
    max_tilt_deg: float
    max_residual: float
    advice: str


TOUCH = Means(
    point="touch",
    min_span=0.15,
    max_tilt_deg=1.0,
    max_residual=0.003,
    advice="Close the fingers, touch the four corners of the square with their tips only, and measure again",
)
"""Finger tips that touch the table."""


@dataclass(frozen=True)
class TouchedTable:
    """The table's plane and the workspace on it.

    Attributes:
        origin: lower corner of the workspace cube in the base frame: T_base_task has this translation and no
            rotation. Shape (3,) [m].
        height: of the table top at the workspace's middle [m].
        tilt_deg: between the table and the base's xy-plane [deg].
        residual: largest distance of a point from the plane [m].
    """

    origin: Array
    height: float
    tilt_deg: float
    residual: float


def touched_table(points: Array, means: Means = TOUCH) -> TouchedTable:
    """The workspace whose middle is the middle of points (N, 3) of the table, in the base frame [m].

    Raises:
        Refused: too few or too close points, a tilted table, or points that lie in no plane.
    """
    if len(points) < MIN_POINTS:
        raise Refused(f"{len(points)} of kind '{means.point}', needed are {MIN_POINTS}. {means.advice}")
    span = np.ptp(points[:, :2], axis=0)
    if span.min() < means.min_span:
        least = f"needed are {means.min_span} m each way"
        raise Refused(f"the points ({means.point}) span {span[0]:.3f} x {span[1]:.3f} m, {least}. {means.advice}")
    middle = (points[:, :2].min(axis=0) + points[:, :2].max(axis=0)) / 2
    A = np.column_stack([points[:, :2] - middle, np.ones(len(points))])
    (a, b, height), *_ = np.linalg.lstsq(A, points[:, 2], rcond=None)
    residual = float(np.abs(A @ np.array([a, b, height]) - points[:, 2]).max())
    tilt = float(np.rad2deg(np.arctan(np.hypot(a, b))))
    if residual > means.max_residual:
        raise Refused(
            f"one {means.point} lies {residual * 1e3:.1f} mm off the plane of all "
            f"(allowed {means.max_residual * 1e3:.0f} mm). {means.advice}"
        )
    if tilt > means.max_tilt_deg:
        raise Refused(
            f"the table is tilted by {tilt:.1f} degrees against the robot's base (allowed {means.max_tilt_deg:g}). "
            f"Level the table or the base. {means.advice}"
        )
    corner = middle - WORKSPACE_SIZE / 2
    return TouchedTable(np.array([*corner, height - TABLE_HEIGHT]), float(height), tilt, residual)
