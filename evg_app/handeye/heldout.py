"""The error on samples that were not fitted (leave-k-out): where the board should be against where it is seen."""

from dataclasses import dataclass

import numpy as np

from evg_app.geometry import Array, invert, rotation_angle, transform_points
from evg_app.handeye.detect import board_pose
from evg_app.handeye.hand_noise import polish
from evg_app.handeye.refine import Fit, corrected, refine
from evg_app.handeye.sample import Views

FOLDS = 5


@dataclass(frozen=True)
class Heldout:
    """Held-out errors of each sample.

    Attributes:
        mm: RMS distance of the board's corners from where they were predicted [mm]. Shape (N,).
        deg: angle between the board seen and predicted [deg]. Shape (N,).
        px: RMS reprojection error of the prediction [px]. Shape (N,).
    """

    mm: Array
    deg: Array
    px: Array

    @property
    def rms_mm(self) -> float:
        """Over all samples [mm]."""
        return float(np.sqrt((self.mm**2).mean()))

    @property
    def rms_deg(self) -> float:
        """Over all samples [deg]."""
        return float(np.sqrt((self.deg**2).mean()))


def held_out(views: Views, fit: Fit, outline: Array, prior: float, seed: int = 0) -> Heldout:
    """Fit without each fifth of the samples in turn, and predict it. `outline`: the board's corners (4, 3) [m]."""
    order = np.random.default_rng(seed).permutation(len(views))
    mm, deg, px = (np.zeros(len(views)) for _ in range(3))
    for fold in np.array_split(order, min(FOLDS, len(views))):
        rest = np.setdiff1d(np.arange(len(views)), fold)
        other = polish(views.take(rest), refine(views.take(rest), fit, prior), prior)
        for k in fold:
            mm[k], deg[k], px[k] = prediction_error(views.take(np.array([k])), other, outline)
    return Heldout(mm, deg, px)


def prediction_error(one: Views, fit: Fit, outline: Array) -> tuple[float, float, float]:
    """Millimetres, degrees and pixels by which a fit misses the board of one sample."""
    predicted = invert(fit.X) @ one.A[0] @ fit.Z
    corners, K = outline * fit.scale, corrected(one.intrinsics, fit.lens)
    seen, _ = board_pose(one.points * fit.scale, one.pixels, K, guess=predicted)
    off = transform_points(seen, corners) - transform_points(predicted, corners)
    p = transform_points(predicted, one.points * fit.scale)
    pixels = np.stack([K.fx * p[:, 0] / p[:, 2] + K.cx, K.fy * p[:, 1] / p[:, 2] + K.cy], axis=1)
    px = float(np.sqrt(((pixels - one.pixels) ** 2).sum(axis=1).mean()))
    mm = 1000 * float(np.sqrt((off**2).sum(axis=1).mean()))
    return mm, float(np.rad2deg(rotation_angle(seen, predicted))), px
