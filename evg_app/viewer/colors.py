"""Colours of candidates: by verdict, or by score."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import Array
from evg_app.types import Verdict

RGB = tuple[int, int, int]
Bytes = NDArray[np.uint8]

VERDICT_COLORS: dict[Verdict, RGB] = {
    Verdict.ACCEPTED: (40, 200, 80),
    Verdict.OUT_OF_WORKSPACE: (150, 110, 70),
    Verdict.WIDTH: (230, 120, 200),
    Verdict.IK: (230, 60, 50),
    Verdict.JOINT_LIMIT: (245, 140, 40),
    Verdict.SELF_COLLISION: (160, 70, 210),
    Verdict.GRIPPER_COLLISION: (210, 30, 110),
    Verdict.ARM_COLLISION: (120, 30, 40),
    Verdict.NO_PATH: (40, 60, 140),
    Verdict.REJECTED: (20, 20, 20),
    Verdict.NOT_EXAMINED: (120, 170, 255),
}
"""Every verdict has a colour of its own."""
CHOSEN: RGB = (255, 205, 10)
"""Of the chosen grasp and its path."""
_RAMP = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], dtype=np.float64)


def by_verdict(verdicts: Sequence[str], n: int) -> Bytes:
    """Colours of n candidates; those without a verdict were not examined. uint8 RGB, shape (n, 3)."""
    words = [*verdicts[:n], *[str(Verdict.NOT_EXAMINED)] * (n - len(verdicts))]
    return np.array([VERDICT_COLORS[Verdict(word)] for word in words], dtype=np.uint8).reshape(n, 3)


def by_share(share: Array) -> Bytes:
    """Dark blue at 0 over green to yellow at 1. Shape (N,) -> uint8 RGB (N, 3)."""
    t = np.clip(np.nan_to_num(np.asarray(share, dtype=np.float64)), 0.0, 1.0) * (len(_RAMP) - 1)
    low = np.minimum(t.astype(int), len(_RAMP) - 2)
    return np.asarray(_RAMP[low] + (t - low)[:, None] * (_RAMP[low + 1] - _RAMP[low]), dtype=np.uint8)
