"""Several depth images of a still scene, merged into one with less noise."""

import numpy as np
from numpy.typing import NDArray

UNIT = 1e-4
"""Metres per unit of a merged image [m]; uint16 then reaches 6.5 m."""
MAX_SPREAD = 0.03
"""A pixel whose images differ by more than this share of its depth is no measurement (an edge, something moving)."""


class DepthMerger:
    """Averages depth per pixel over the images that have one.

    A pixel counts when at least half of the images measured it and they agree within `MAX_SPREAD`.
    """

    def __init__(self) -> None:
        self._count = 0
        self._sum = self._hits = self._low = self._high = np.zeros(0, np.uint32)

    def add(self, depth: NDArray[np.uint16]) -> None:
        """Take one raw image, 0 where nothing was measured. Shape (H, W), the same for all."""
        valid = depth > 0
        floor = np.where(valid, depth, np.uint16(65535))
        if self._count == 0:
            self._sum, self._hits = depth.astype(np.uint32), valid.astype(np.uint32)
            self._low, self._high = floor.astype(np.uint32), depth.astype(np.uint32)
        else:
            self._sum += depth
            self._hits += valid
            np.minimum(self._low, floor, out=self._low)
            np.maximum(self._high, depth, out=self._high)
        self._count += 1

    def result(self, depth_scale: float) -> tuple[NDArray[np.uint16], float]:
        """The merged image and its metres per unit.

        Args:
            depth_scale: metres per unit of the images that were added [m].
        """
        hits = np.maximum(self._hits, 1)
        mean = self._sum / hits
        keep = (self._hits * 2 >= self._count) & (self._hits > 0) & (self._high - self._low <= MAX_SPREAD * mean)
        scaled = np.rint(mean * (depth_scale / UNIT))
        keep &= scaled <= np.iinfo(np.uint16).max
        return np.where(keep, scaled, 0).astype(np.uint16), UNIT
