"""A check that needs no board: does the depth camera see the table flat, level and where the workspace has it?"""

from dataclasses import dataclass

import numpy as np

from evg_app.geometry import TABLE_HEIGHT, WORKSPACE_SIZE, Array, invert, transform_points
from evg_app.handeye.diagnose import Finding
from evg_app.handeye.sample import STRIDE, Sample, Session

AROUND = 0.10
"""The table is looked at up to this far around the workspace [m]."""
BAND = 0.05
"""Points up to this far from the expected height may be table [m]."""
LEAST_POINTS = 300
"""Fewer say nothing."""
MAX_TILT, MAX_OFFSET = 1.5, 0.008
"""Tilt [deg] and height [m] from which on something is wrong."""


@dataclass(frozen=True)
class TableFit:
    """The fused table against the workspace.

    Attributes:
        tilt_deg: angle between the seen and the configured table.
        offset_mm: seen height minus configured height, in the middle of the workspace.
        flatness_mm: RMS distance of the points from their plane.
        points: how many.
    """

    tilt_deg: float
    offset_mm: float
    flatness_mm: float
    points: int


def fit_table(session: Session, X: Array, depth_factor: float) -> TableFit | None:
    """Fuse the depth of all samples with the camera at X (4, 4), its depth multiplied by `depth_factor`.

    None when too little of the table was seen.
    """
    points = [_table_points(session, sample, X, depth_factor) for sample in session.usable()]
    p = np.concatenate(points) if points else np.zeros((0, 3))
    for _ in range(3):
        if len(p) < LEAST_POINTS:
            return None
        centre = np.median(p, axis=0)
        normal = np.linalg.svd(p - p.mean(axis=0), full_matrices=False)[2][2]
        normal = normal if normal[2] > 0 else -normal
        off = (p - p.mean(axis=0)) @ normal
        keep = np.abs(off - np.median(off)) < max(3 * 1.4826 * float(np.median(np.abs(off - np.median(off)))), 1e-4)
        rest, p = off[keep], p[keep]
    middle = np.array([WORKSPACE_SIZE / 2, WORKSPACE_SIZE / 2])
    height = centre[2] - float(normal[:2] @ (middle - centre[:2])) / float(normal[2])
    tilt = float(np.rad2deg(np.arccos(min(float(normal[2]), 1.0))))
    return TableFit(tilt, 1000 * (height - TABLE_HEIGHT), 1000 * float(rest.std()), len(p))


def _table_points(session: Session, sample: Sample, X: Array, factor: float) -> Array:
    """Points near the table, in the task frame. Shape (P, 3)."""
    depth = sample.coarse_depth
    if depth.size == 0:
        return np.zeros((0, 3))
    K = session.intrinsics
    v, u = np.nonzero(depth > 0)
    z = depth[v, u].astype(np.float64) * factor
    cam = np.stack([(u * STRIDE - K.cx) / K.fx * z, (v * STRIDE - K.cy) / K.fy * z, z], axis=1)
    T_base_cam = X if session.mode == "eye-to-hand" else sample.T_base_hand @ X
    p = transform_points(invert(session.T_base_task) @ T_base_cam, cam)
    low, high = -AROUND, WORKSPACE_SIZE + AROUND
    inside = ((p[:, :2] > low) & (p[:, :2] < high)).all(axis=1) & (np.abs(p[:, 2] - TABLE_HEIGHT) < BAND)
    return np.asarray(p[inside])


def depth_factor(session: Session, scale: float) -> float:
    """Board's distance by its corners over that by depth (median); 1 where depth does not show the board."""
    ratios = []
    for s in session.usable():
        if len(s.board_depth) != len(s.detection.ids):
            continue
        T = s.detection.T_cam_board
        expected = (session.board.points[s.detection.ids] @ T[2, :3] + T[2, 3]) * scale
        good = np.isfinite(s.board_depth) & (s.board_depth > 0)
        if good.sum() >= 6:
            ratios.append(float(np.median(expected[good] / s.board_depth[good])))
    return float(np.median(ratios)) if len(ratios) >= 3 else 1.0


def table_findings(fit: TableFit | None) -> list[Finding]:
    """What the table says about the result."""
    if fit is None or (fit.tilt_deg <= MAX_TILT and abs(fit.offset_mm) <= 1000 * MAX_OFFSET):
        return []
    text = (
        f"the table is seen tilted by {fit.tilt_deg:.1f} deg and {fit.offset_mm:+.0f} mm off the height that "
        "T_base_task gives it: check T_base_task, or distrust this result"
    )
    return [Finding("table", "warn", text)]
