"""The known table as a ruler: stereo depth is wrong by a common factor, and the table's height is known."""

from dataclasses import dataclass, replace

import numpy as np

from evg_app.geometry import TABLE_HEIGHT, WORKSPACE_SIZE, Array, invert
from evg_app.types import Frame

STRIDE = 4
"""Every STRIDE-th row and column is looked at."""
MARGIN = 0.15
"""The table is looked at up to this far around the workspace [m]."""
MAX_BIAS = 0.12
"""Largest relative error of depth that is still taken for a bias."""
BIN = 0.002
"""Width of a bin when the most frequent ratio is looked for."""
INLIER = 0.012
"""A pixel is table when its ratio is this close to the most frequent one."""
MIN_PIXELS = 400
"""Fewer table pixels (of every STRIDE-th) say nothing."""
MIN_SHARE = 0.25
"""Least share of the pixels that look at the table's place and must agree."""


@dataclass(frozen=True)
class TableFit:
    """How the measured table compares with the known one.

    Attributes:
        scale: true depth over measured depth; 1 when too little of the table was seen.
        noise: median absolute deviation of the table's depth after scaling [m], 0 when it was not seen.
        share: share of the pixels at the table's place that are table.
    """

    scale: float
    noise: float
    share: float

    @property
    def seen(self) -> bool:
        """Whether enough of the table was seen."""
        return self.share > 0


def fit_table(frame: Frame, T_cam_task: Array) -> TableFit:
    """Compare depth with the plane z = `TABLE_HEIGHT` of the task frame. T_cam_task: (4, 4)."""
    measured = frame.depth[::STRIDE, ::STRIDE].astype(np.float64) * frame.depth_scale
    expected = expected_depth(frame, T_cam_task)
    looks = (measured > 0) & np.isfinite(expected)
    ratio = expected[looks] / measured[looks]
    near = ratio[np.abs(ratio - 1.0) < MAX_BIAS]
    if len(near) < MIN_PIXELS:
        return TableFit(1.0, 0.0, 0.0)
    counts, edges = np.histogram(near, bins=np.arange(1 - MAX_BIAS, 1 + MAX_BIAS + BIN, BIN))
    peak = int(np.argmax(np.convolve(counts, np.ones(3), mode="same")))
    center = edges[peak] + BIN / 2
    inlier = np.abs(ratio - center) < INLIER
    share = float(inlier.mean())
    if inlier.sum() < MIN_PIXELS or share < MIN_SHARE:
        return TableFit(1.0, 0.0, 0.0)
    scale = float(np.median(ratio[inlier]))
    off = measured[looks][inlier] * scale - expected[looks][inlier]
    return TableFit(scale, float(np.median(np.abs(off))), share)


def rescale(frame: Frame, scale: float) -> Frame:
    """The frame with its depth multiplied by `scale`; raw values are kept."""
    return replace(frame, depth_scale=frame.depth_scale * scale)


def expected_depth(frame: Frame, T_cam_task: Array) -> Array:
    """Depth [m] of the table at every STRIDE-th pixel, NaN where the ray misses the table's place."""
    K, T_task_cam = frame.intrinsics, invert(T_cam_task)
    u = (np.arange(0, K.width, STRIDE) - K.cx) / K.fx
    v = (np.arange(0, K.height, STRIDE) - K.cy) / K.fy
    rays = np.stack(np.broadcast_arrays(u[None, :], v[:, None], 1.0), axis=-1) @ T_task_cam[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (TABLE_HEIGHT - T_task_cam[2, 3]) / rays[..., 2]
        at = T_task_cam[:3, 3] + depth[..., None] * rays
    inside = ((at[..., :2] > -MARGIN) & (at[..., :2] < WORKSPACE_SIZE + MARGIN)).all(axis=-1) & (depth > 0)
    return np.where(inside, depth, np.nan)
