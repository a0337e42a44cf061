"""A picture of an attempt: what the camera saw, the candidates, and the gripper of the chosen grasp."""

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from evg_app.geometry import FINGER_DEPTH, MAX_OPENING, Array, invert, transform_points
from evg_app.trials.arrays import Gathered
from evg_app.types import Frame, Intrinsics, Verdict

RGB = tuple[int, int, int]

ACCEPTED: RGB = (60, 220, 90)
REFUSED: RGB = (240, 90, 60)
WAITING: RGB = (120, 170, 255)
"""Colours of candidates by verdict: accepted, refused for a reason, not examined."""
GRIPPER: RGB = (255, 214, 10)
"""Colour of the chosen grasp."""
PALM_BACK = -0.06
"""How far the drawn wrist reaches behind the palm [m]."""
MAX_DOTS = 400
"""Candidates that are drawn, best last so that they lie on top."""

_RAMP = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], dtype=np.float64)


def depth_as_color(frame: Frame) -> NDArray[np.uint8]:
    """Near is bright, far is dark, no measurement is black. uint8 RGB, shape (H, W, 3)."""
    metres = frame.metres()
    valid = metres > 0
    if not valid.any():
        return np.zeros((*metres.shape, 3), dtype=np.uint8)
    near, far = np.percentile(metres[valid], [2, 98])
    t = np.clip((far - metres) / max(far - near, 1e-3), 0.0, 1.0) * (len(_RAMP) - 1)
    low = np.minimum(t.astype(int), len(_RAMP) - 2)
    color = _RAMP[low] + (t - low)[..., None] * (_RAMP[low + 1] - _RAMP[low])
    color[~valid] = 0
    return np.asarray(color, dtype=np.uint8)


def project(points: Array, intrinsics: Intrinsics) -> NDArray[np.float64]:
    """Pixels (u, v) of points in the camera frame [m]; NaN behind the camera. Shapes (N, 3) -> (N, 2)."""
    z = np.where(points[:, 2] > 1e-3, points[:, 2], np.nan)
    u = points[:, 0] / z * intrinsics.fx + intrinsics.cx
    v = points[:, 1] / z * intrinsics.fy + intrinsics.cy
    return np.stack([u, v], axis=1)


def gripper_lines(width: float) -> Array:
    """Segments of a gripper in the grasp frame: wrist, palm, two fingers. Shape (4, 2, 3) [m]."""
    y = min(max(width, 0.01), MAX_OPENING) / 2
    return np.array(
        [
            [[0, 0, PALM_BACK], [0, 0, 0]],
            [[0, -y, 0], [0, y, 0]],
            [[0, -y, 0], [0, -y, FINGER_DEPTH]],
            [[0, y, 0], [0, y, FINGER_DEPTH]],
        ],
        dtype=np.float64,
    )


def draw(gathered: Gathered, caption: str) -> NDArray[np.uint8] | None:
    """The picture of a pass, or None when it never got a frame. uint8 RGB, shape (H, W, 3)."""
    if gathered.frame is None:
        return None
    frame = gathered.frame.frame
    image = Image.fromarray(frame.color if frame.color is not None else depth_as_color(frame))
    pen = ImageDraw.Draw(image)
    T_cam_base = invert(gathered.frame.T_base_cam)
    _dots(pen, gathered, np.asarray(T_cam_base @ gathered.frame.T_base_task), frame.intrinsics)
    judged = gathered.judged
    if judged is not None and judged.T_base_grasp is not None and judged.chosen is not None:
        width = float(gathered.grasps.width[judged.chosen])
        _gripper(pen, np.asarray(T_cam_base @ judged.T_base_grasp), width, frame.intrinsics)
    box = pen.textbbox((6, 4), caption)
    pen.rectangle((0, 0, box[2] + 6, box[3] + 4), fill=(0, 0, 0))
    pen.text((6, 4), caption, fill=(255, 255, 255))
    return np.asarray(image, dtype=np.uint8)


def _dots(pen: Any, gathered: Gathered, T_cam_task: Array, intrinsics: Intrinsics) -> None:
    """A dot between the finger tips of every candidate; brighter with a higher score."""
    grasps = gathered.grasps
    n = min(len(grasps), MAX_DOTS)
    tips = grasps.T_task_grasp[:n, :3, 3] + FINGER_DEPTH * grasps.T_task_grasp[:n, :3, 2]
    pixels = project(transform_points(T_cam_task, tips), intrinsics)
    verdicts = () if gathered.judged is None else gathered.judged.verdicts
    for i in reversed(range(n)):
        u, v = pixels[i]
        if np.isfinite(u) and np.isfinite(v):
            color = _shade(verdicts[i] if i < len(verdicts) else Verdict.NOT_EXAMINED, float(grasps.score[i]))
            pen.ellipse((u - 2, v - 2, u + 2, v + 2), fill=color)


def _shade(verdict: Verdict, score: float) -> RGB:
    """Colour of a candidate: by verdict, brighter with its score."""
    base = {Verdict.ACCEPTED: ACCEPTED, Verdict.NOT_EXAMINED: WAITING}.get(verdict, REFUSED)
    light = 0.45 + 0.55 * min(max(score, 0.0), 1.0)
    return int(base[0] * light), int(base[1] * light), int(base[2] * light)


def _gripper(pen: Any, T_cam_grasp: Array, width: float, intrinsics: Intrinsics) -> None:
    """Draw the chosen grasp."""
    for line in gripper_lines(width):
        pixels = project(transform_points(T_cam_grasp, line), intrinsics)
        if np.isfinite(pixels).all():
            ends = [tuple(point) for point in pixels.tolist()]
            pen.line(ends, fill=(0, 0, 0), width=6)
            pen.line(ends, fill=GRIPPER, width=3)


def png(image: NDArray[np.uint8]) -> bytes:
    """The image as a PNG file."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()
