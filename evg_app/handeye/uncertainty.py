"""How far a result can be off: jackknife over samples, and the 95 % bound over the workspace cube."""

from dataclasses import dataclass

import numpy as np

from evg_app.geometry import Array, invert, transform_points
from evg_app.handeye.hand_noise import likeliest
from evg_app.handeye.refine import UNKNOWNS, Fit, known
from evg_app.handeye.rigid import exp
from evg_app.handeye.sample import Views

DRAWS = 2000
"""Random results from which the bound is read."""
QUANTILE = 0.95
UNSEEN_M = 0.0005
"""Errors that samples cannot show, added to the bound: rounding of the arm's kinematics, drift [m]."""
UNKNOWN = 1.0
"""What is known of a direction that no sample determines: it is within about a metre, or a radian."""


@dataclass(frozen=True)
class Uncertainty:
    """Confidence of a fit.

    Attributes:
        covariance: of the unknowns [m, rad]: X translation and rotation, Z the same, log scale, lens. Shape (16, 16).
        bound_mm, bound_deg: 95 % upper bound of the displacement over the cube, and of the rotation error.
    """

    covariance: Array
    bound_mm: float
    bound_deg: float

    @property
    def scale_std(self) -> float:
        """Standard deviation of the board's relative size."""
        return float(np.sqrt(self.covariance[12, 12]))

    @property
    def lens_std(self) -> Array:
        """Standard deviation of focal length (relative) and principal point [px]. Shape (3,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[13:]))

    def stds(self) -> Array:
        """Of the camera's translation [m] (3) and rotation [rad] (3). Shape (6,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[:6]))


def jackknife(views: Views, fit: Fit, prior: float) -> Array:
    """Covariance (16, 16) from what leaving out each sample would change (one Gauss-Newton step), plus the model's own.

    The model's own alone knows directions that no sample determines, and what is not known about board size and lens.
    """
    blocks, _ = likeliest(views, fit, prior)
    H, g, n = blocks[:, :UNKNOWNS, :UNKNOWNS], blocks[:, :UNKNOWNS, UNKNOWNS], len(views)
    whole = H.sum(axis=0) + np.diag(known(prior)) + np.eye(UNKNOWNS) / UNKNOWN**2
    steps = np.stack([np.linalg.lstsq(whole - H[k], g[k], rcond=None)[0] for k in range(n)])
    steps -= steps.mean(axis=0)
    return np.asarray((n - 1) / n * steps.T @ steps + np.linalg.inv(whole))


def uncertainty(views: Views, fit: Fit, cube_parent: Array, prior: float, seed: int = 0) -> Uncertainty:
    """Confidence of a fit over the workspace cube, given in the camera's parent frame (P, 3)."""
    covariance = jackknife(views, fit, prior)
    rng = np.random.default_rng(seed)
    freedom = max(len(views) - 6, 2)
    root = _root(covariance[:6, :6])
    draws = rng.standard_normal((DRAWS, 6)) @ root.T
    draws /= np.sqrt(rng.chisquare(freedom, DRAWS) / freedom)[:, None]
    in_cam = transform_points(invert(fit.X), cube_parent)
    turns = exp(np.clip(draws[:, 3:], -np.pi, np.pi)) - np.eye(3)
    off = np.einsum("ij,djk,pk->dpi", fit.X[:3, :3], turns, in_cam) + draws[:, None, :3]
    rms = np.sqrt((off**2).sum(axis=2).mean(axis=1))
    bound = float(np.hypot(np.quantile(rms, QUANTILE), UNSEEN_M))
    angle = float(np.quantile(np.linalg.norm(draws[:, 3:], axis=1), QUANTILE))
    return Uncertainty(covariance, 1000 * bound, float(np.rad2deg(angle)))


def _root(covariance: Array) -> Array:
    """L with L L^T = covariance, also when it is singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
