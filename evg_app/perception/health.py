"""Is this depth image good enough to plan on? If not, why, and what to do."""

from dataclasses import dataclass

import numpy as np

from evg_app.errors import Refused
from evg_app.geometry import Array
from evg_app.perception.projection import voxel_pixels
from evg_app.types import Frame

MIN_IN_VIEW = 0.7
"""Share of the workspace's voxels that must project into the image."""
MIN_VALID = 0.3
"""Share of the pixels on the workspace that must carry a depth (a camera config may set its own)."""
MIN_NEAR = 0.02
"""Share of the workspace's voxels in view whose pixel measured something within `NEAR` of the voxel."""
NEAR = 0.03
"""How close a measurement must come to a voxel to touch the workspace there [m]."""


@dataclass(frozen=True)
class DepthHealth:
    """How well one depth image shows the workspace.

    Attributes:
        in_view: share of the workspace's voxels that project into the image.
        valid: share of those whose pixel carries a depth.
        near: share of those whose pixel measured a surface within `NEAR` of the voxel.
        advice: what to do, empty when the image is good enough.
        min_valid: the least `valid` that was asked for.
    """

    in_view: float
    valid: float
    near: float
    advice: str
    min_valid: float = MIN_VALID

    @property
    def ok(self) -> bool:
        """Whether a plan may be made on it."""
        return not self.advice

    def require(self) -> None:
        """Pass when ok.

        Raises:
            Refused: with the numbers and the advice.
        """
        if not self.ok:
            raise Refused(
                f"depth image refused: {self.in_view:.0%} of the workspace in view (at least {MIN_IN_VIEW:.0%}), "
                f"{self.valid:.0%} of it with depth (at least {self.min_valid:.0%}), "
                f"{self.near:.1%} near a surface (at least {MIN_NEAR:.0%}). {self.advice}"
            )


def depth_health(frame: Frame, T_cam_task: Array, min_valid: float = MIN_VALID) -> DepthHealth:
    """Judge a frame by the pixels that the workspace's 40^3 voxels project to (about 1.5 ms)."""
    pixels = voxel_pixels(frame.intrinsics, T_cam_task)
    in_view = float(pixels.inside.mean())
    raw = frame.depth.ravel().take(pixels.pixel[pixels.inside])
    seen = raw > 0
    gap = np.abs(raw.astype(np.float32) * np.float32(frame.depth_scale) - pixels.z[pixels.inside])
    valid = float(seen.mean()) if len(raw) else 0.0
    near = float((seen & (gap < NEAR)).mean()) if len(raw) else 0.0
    return DepthHealth(in_view, valid, near, _advice(in_view, valid, near, min_valid), min_valid)


def _advice(in_view: float, valid: float, near: float, min_valid: float) -> str:
    """The first thing to mend, or nothing."""
    if in_view < MIN_IN_VIEW:
        return "The camera does not see the workspace: turn it there, or its calibration is wrong. Run: evg-app doctor"
    if valid < min_valid:
        return (
            "Too many pixels without depth: check lens and light, avoid mirrors and glare, "
            "keep the camera 0.3 to 1.5 m away. Run: evg-app doctor"
        )
    if near < MIN_NEAR:
        return (
            "No surface lies in the workspace, not even the table: the calibration or the workspace's pose is wrong. "
            "Run: evg-app doctor"
        )
    return ""
