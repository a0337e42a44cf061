"""The known table as a judge of depth: how noisy, how far off and how tilted it is measured."""

from dataclasses import dataclass

import numpy as np

from evg_app.geometry import TABLE_HEIGHT, WORKSPACE_SIZE, Array, transform_points
from evg_app.perception.table import STRIDE, expected_depth, fit_table
from evg_app.types import Frame

ROBUST = 1.4826
"""Standard deviation over median absolute deviation of normal noise."""
WINDOW = 0.05
"""A pixel may be table when its depth is within this share of the coarsely fitted table's: noise is not cut off."""
TRIM = 3.0
"""Pixels further from the fitted plane than this many deviations are no table (objects, edges)."""
ROUNDS = 3
"""How often the plane is fitted and trimmed."""


@dataclass(frozen=True)
class TableHealth:
    """The seen table against the known one.

    Attributes:
        seen: enough of it was seen; otherwise the numbers are 0.
        share: share of the pixels at the table's place that are table.
        noise: standard deviation of depth about the seen plane [m] (robust).
        bias: seen minus known distance at the middle of the workspace [m].
        bias_ratio: `bias` over the known distance.
        tilt_deg: angle between the seen and the known plane [deg].
    """

    seen: bool
    share: float = 0.0
    noise: float = 0.0
    bias: float = 0.0
    bias_ratio: float = 0.0
    tilt_deg: float = 0.0


def table_health(frame: Frame, T_cam_task: Array) -> TableHealth:
    """Fit a plane to the pixels that are table and compare it with z = `TABLE_HEIGHT`. T_cam_task: (4, 4).

    The plane is fitted to inverse depth, which is linear in the pixel.
    """
    coarse = fit_table(frame, T_cam_task)
    if not coarse.seen:
        return TableHealth(False)
    K = frame.intrinsics
    depth = frame.depth[::STRIDE, ::STRIDE].astype(np.float64) * frame.depth_scale
    known = expected_depth(frame, T_cam_task)
    with np.errstate(divide="ignore", invalid="ignore"):
        table = np.isfinite(known) & (depth > 0) & (np.abs(known / depth / coarse.scale - 1.0) < WINDOW)
    rows, columns = np.nonzero(table)
    a = np.stack([(columns * STRIDE - K.cx) / K.fx, (rows * STRIDE - K.cy) / K.fy, np.ones(len(rows))], axis=1)
    normal, noise = _plane(a, depth[table])
    middle = transform_points(T_cam_task, [WORKSPACE_SIZE / 2, WORKSPACE_SIZE / 2, TABLE_HEIGHT])
    seen_depth = 1.0 / float(normal @ (middle / middle[2]))
    up = T_cam_task[:3, 2]
    cosine = abs(float(normal @ up)) / float(np.linalg.norm(normal))
    bias = seen_depth - float(middle[2])
    tilt = float(np.degrees(np.arccos(min(cosine, 1.0))))
    return TableHealth(True, coarse.share, noise, bias, bias / float(middle[2]), tilt)


def _plane(rays: Array, depth: Array) -> tuple[Array, float]:
    """n with n . p = 1 for points p of the plane, and the noise of depth about it [m]. Shapes (N, 3), (N,)."""
    keep = np.ones(len(depth), dtype=bool)
    normal: Array = np.zeros(3)
    noise = 0.0
    for _ in range(ROUNDS):
        normal = np.asarray(np.linalg.lstsq(rays[keep], 1.0 / depth[keep], rcond=None)[0], dtype=np.float64)
        off = depth - 1.0 / (rays @ normal)
        noise = ROBUST * float(np.median(np.abs(off[keep] - np.median(off[keep]))))
        keep = np.abs(off) <= max(TRIM * noise, 1e-6)
    return normal, noise
