"""Lens distortion taken out of pixels."""

import numpy as np

from evg_app.geometry import Array
from evg_app.handeye.boards import opencv
from evg_app.types import Intrinsics


def undistort(pixels: Array, intrinsics: Intrinsics) -> Array:
    """Where the pixels (n, 2) would be without lens distortion, same K. Shape (n, 2)."""
    if not any(intrinsics.distortion) or len(pixels) == 0:
        return pixels
    cv2 = opencv()
    k = np.asarray(intrinsics.distortion, dtype=np.float64)
    flat = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
    ideal = cv2.undistortPointsIter(flat, intrinsics.K, k, None, intrinsics.K, stop)
    return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)
