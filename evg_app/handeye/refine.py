"""Non-linear refinement of the reprojection error over camera, board and board size, with a robust loss.

Model of both modes: p_cam = X^-1 A_i Z (s p). Unknowns: X and Z (translation, rotation) and log s with a prior.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from evg_app.geometry import Array, invert
from evg_app.handeye.rigid import exp, hat, moved, right_jacobian
from evg_app.handeye.sample import Views

UNKNOWNS = 13
SCALE_PRIOR = 0.002
"""How well the size of a printed board that was checked with a ruler is known (standard deviation, relative)."""
FREE_SCALE = 1.0
"""Prior that says nothing."""
ROBUST_PX = 1.0
"""Residual from which on corners count less [px]."""
FAR_PX = 1e4


@dataclass(frozen=True)
class Fit:
    """A solution.

    Attributes:
        X: camera in the parent frame. Shape (4, 4).
        Z: board in the other frame. Shape (4, 4).
        scale: true over nominal size of the board.
        residuals: of every corner [px]. Shape (M, 2).
    """

    X: Array
    Z: Array
    scale: float
    residuals: Array

    @property
    def rms(self) -> float:
        """RMS distance of the corners from where the model puts them [px]."""
        return float(np.sqrt((self.residuals**2).sum(axis=1).mean()))

    def sample_rms(self, views: Views) -> Array:
        """The same of each sample. Shape (N,)."""
        squares = (self.residuals**2).sum(axis=1)
        total = np.bincount(views.sample, squares, len(views))
        return np.asarray(np.sqrt(total / np.maximum(np.bincount(views.sample, minlength=len(views)), 1)))


def project_all(views: Views, X: Array, Z: Array, scale: float) -> tuple[Array, Array, Array]:
    """Points in the camera (M, 3), pixels (M, 2), and rotation board to camera of each sample (N, 3, 3)."""
    T = invert(X) @ views.A @ Z
    R = T[:, :3, :3]
    p = np.einsum("mij,mj->mi", R[views.sample], views.points * scale) + T[views.sample, :3, 3]
    z = np.maximum(p[:, 2], 1e-3)
    K = views.intrinsics
    pixels = np.stack([K.fx * p[:, 0] / z + K.cx, K.fy * p[:, 1] / z + K.cy], axis=1)
    return p, pixels, R


def residuals(views: Views, X: Array, Z: Array, scale: float) -> Array:
    """Distance of the seen corners from where the model puts them; far for points behind the camera. (M, 2) [px]."""
    p, pixels, _ = project_all(views, X, Z, scale)
    off = np.clip(pixels - views.pixels, -FAR_PX, FAR_PX)
    off[p[:, 2] <= 1e-3] = FAR_PX
    return np.asarray(off)


def fit_at(views: Views, X: Array, Z: Array, scale: float = 1.0) -> Fit:
    """The model as it is, unrefined."""
    return Fit(X, Z, scale, residuals(views, X, Z, scale))


def jacobian(views: Views, X: Array, Z: Array, scale: float, w_x: Array, w_z: Array) -> Array:
    """Derivative of the residuals by the 13 unknowns at X, Z whose last rotation steps were w_x, w_z. (M, 2, 13)."""
    p, _, R = project_all(views, X, Z, scale)
    z = np.maximum(p[:, 2], 1e-3)
    K = views.intrinsics
    D = np.zeros((len(p), 2, 3))
    D[:, 0, 0], D[:, 0, 2] = K.fx / z, -K.fx * p[:, 0] / z**2
    D[:, 1, 1], D[:, 1, 2] = K.fy / z, -K.fy * p[:, 1] / z**2
    to_cam = np.einsum("ij,njk->nik", X[:3, :3].T, views.A[:, :3, :3])[views.sample]
    Rm, sp = R[views.sample], views.points * scale
    J = np.empty((len(p), 2, UNKNOWNS))
    J[:, :, 0:3] = -D @ X[:3, :3].T
    J[:, :, 3:6] = D @ (hat(p) @ right_jacobian(w_x))
    J[:, :, 6:9] = D @ to_cam
    J[:, :, 9:12] = -D @ (Rm @ hat(sp) @ right_jacobian(w_z))
    J[:, :, 12] = (D @ (Rm @ sp[:, :, None]))[:, :, 0]
    return J


def refine(
    views: Views, X: Array, Z: Array, scale: float = 1.0, prior: float = SCALE_PRIOR, robust: bool = True
) -> Fit:
    """Minimise the reprojection error from a start. `prior`: standard deviation of log scale about 0."""
    start = float(np.log(scale))

    def unpack(x: Array) -> tuple[Array, Array, float]:
        return moved(X, x[:6]), moved(Z, x[6:12]), float(np.exp(np.clip(start + x[12], -1, 1)))

    def error(x: Array) -> Array:
        return np.append(residuals(views, *unpack(x)).ravel(), (start + x[12]) / prior)

    def derivative(x: Array) -> Array:
        J = jacobian(views, *unpack(x), x[3:6], x[9:12]).reshape(-1, UNKNOWNS)
        last = np.zeros((1, UNKNOWNS))
        last[0, 12] = 1.0 / prior
        return np.concatenate([J, last])

    found = least_squares(
        error,
        np.zeros(UNKNOWNS),
        derivative,
        method="trf",
        loss="cauchy" if robust else "linear",
        f_scale=ROBUST_PX,
        x_scale=np.array([0.05] * 3 + [0.1] * 3 + [0.05] * 3 + [0.1] * 3 + [0.02]),
        max_nfev=60,
        ftol=1e-9,
        xtol=1e-9,
    )
    X, Z, scale = unpack(found.x)
    return fit_at(views, X, Z, scale)


__all__ = ["Fit", "exp", "fit_at", "jacobian", "project_all", "refine", "residuals"]
