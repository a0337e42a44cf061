"""Non-linear refinement of the reprojection error over camera, board, board size and lens, with a robust loss.

Model of both modes: p_cam = X^-1 A_i Z (s p), seen through the stream's intrinsics K. Unknowns: X and Z (translation,
rotation), and with priors log s, log of the focal length over K's, and principal point minus K's [px].
A constant error of the tool is no unknown: it is one with the board's place (eye-to-hand) or the camera's
(eye-in-hand).
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import least_squares

from evg_app.geometry import Array, invert
from evg_app.handeye.rigid import hat, moved, right_jacobian
from evg_app.handeye.sample import Views
from evg_app.types import Intrinsics

UNKNOWNS = 16
SCALE_PRIOR = 0.002
"""How well the size of a printed board that was checked with a ruler is known (standard deviation, relative)."""
FREE_SCALE = 1.0
"""Prior that says nothing."""
LENS_PRIOR = np.array([0.002, 1.5, 1.5])
"""How well a factory knows focal length (relative) and principal point [px] (standard deviations)."""
ROBUST_PX = 1.0
"""Residual from which on corners count less [px]."""
FAR_PX = 1e4
STEPS = np.array([0.05] * 3 + [0.1] * 3 + [0.05] * 3 + [0.1] * 3 + [0.02] + [0.01, 2.0, 2.0])
"""Sizes of the unknowns for the optimiser [m, rad, 1, px]."""


@dataclass(frozen=True)
class Fit:
    """A solution.

    Attributes:
        X: camera in the parent frame. Shape (4, 4).
        Z: board in the other frame. Shape (4, 4).
        scale: true over nominal size of the board.
        residuals: of every corner [px]. Shape (M, 2).
        lens: log focal length over the stream's, and principal point minus the stream's [px]. Shape (3,).
    """

    X: Array
    Z: Array
    scale: float
    residuals: Array
    lens: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def rms(self) -> float:
        """RMS distance of the corners from where the model puts them [px]."""
        return float(np.sqrt((self.residuals**2).sum(axis=1).mean()))

    def sample_rms(self, views: Views) -> Array:
        """The same of each sample. Shape (N,)."""
        squares = (self.residuals**2).sum(axis=1)
        total = np.bincount(views.sample, squares, len(views))
        return np.asarray(np.sqrt(total / np.maximum(np.bincount(views.sample, minlength=len(views)), 1)))


def known(scale_prior: float) -> Array:
    """What is known before any sample: the diagonal of the information. Shape (16,)."""
    return np.concatenate([np.zeros(12), [1.0 / scale_prior**2], 1.0 / LENS_PRIOR**2])


def corrected(K: Intrinsics, lens: Array) -> Intrinsics:
    """Intrinsics with focal length and principal point of a fit (3,)."""
    factor = float(np.exp(lens[0]))
    return replace(K, fx=K.fx * factor, fy=K.fy * factor, cx=K.cx + float(lens[1]), cy=K.cy + float(lens[2]))


def lens_between(nominal: Intrinsics, found: Intrinsics) -> Array:
    """The opposite of `corrected`. Shape (3,)."""
    return np.array([np.log(found.fx / nominal.fx), found.cx - nominal.cx, found.cy - nominal.cy])


def through(views: Views, lens: Array) -> Views:
    """The same views with the lens of a fit (3,)."""
    return replace(views, intrinsics=corrected(views.intrinsics, lens))


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


def fit_at(views: Views, X: Array, Z: Array, scale: float = 1.0, lens: Array | None = None) -> Fit:
    """The model as it is, unrefined."""
    lens = np.zeros(3) if lens is None else lens
    return Fit(X, Z, scale, residuals(through(views, lens), X, Z, scale), lens)


def by_point(views: Views, p: Array) -> Array:
    """Derivative of the pixels by the points in the camera (M, 3). Shape (M, 2, 3)."""
    z = np.maximum(p[:, 2], 1e-3)
    K = views.intrinsics
    D = np.zeros((len(p), 2, 3))
    D[:, 0, 0], D[:, 0, 2] = K.fx / z, -K.fx * p[:, 0] / z**2
    D[:, 1, 1], D[:, 1, 2] = K.fy / z, -K.fy * p[:, 1] / z**2
    return D


def jacobian(views: Views, X: Array, Z: Array, scale: float, w_x: Array, w_z: Array) -> Array:
    """Derivative of the residuals by the unknowns at X, Z whose last rotation steps were w_x, w_z. (M, 2, 16).

    `views`: with the lens of the fit (see `through`).
    """
    p, pixels, R = project_all(views, X, Z, scale)
    D = by_point(views, p)
    to_cam = np.einsum("ij,njk->nik", X[:3, :3].T, views.A[:, :3, :3])[views.sample]
    Rm, sp = R[views.sample], views.points * scale
    J = np.empty((len(p), 2, UNKNOWNS))
    J[:, :, 0:3] = -D @ X[:3, :3].T
    J[:, :, 3:6] = D @ (hat(p) @ right_jacobian(w_x))
    J[:, :, 6:9] = D @ to_cam
    J[:, :, 9:12] = -D @ (Rm @ hat(sp) @ right_jacobian(w_z))
    J[:, :, 12] = (D @ (Rm @ sp[:, :, None]))[:, :, 0]
    J[:, :, 13] = pixels - [views.intrinsics.cx, views.intrinsics.cy]
    J[:, :, 14:] = np.eye(2)
    return J


def refine(views: Views, start: Fit, prior: float = SCALE_PRIOR, robust: bool = True) -> Fit:
    """Minimise the reprojection error from a start. `prior`: standard deviation of log scale about 0."""
    log_scale, trust = float(np.log(start.scale)), np.sqrt(known(prior))

    def unpack(x: Array) -> tuple[Views, Array, Array, float]:
        """The model after a step (16,)."""
        scale = float(np.exp(np.clip(log_scale + x[12], -1, 1)))
        return through(views, _lens(x)), moved(start.X, x[:6]), moved(start.Z, x[6:12]), scale

    def _lens(x: Array) -> Array:
        """The lens after a step (16,), never absurd. Shape (3,)."""
        return np.clip(start.lens + x[13:], [-0.5, -500, -500], [0.5, 500, 500])

    def error(x: Array) -> Array:
        """Residuals of corners and of what was known before."""
        tied = trust[12:] * np.concatenate([[log_scale + x[12]], start.lens + x[13:]])
        return np.concatenate([residuals(*unpack(x)).ravel(), tied])

    def derivative(x: Array) -> Array:
        """Of `error`."""
        J = jacobian(*unpack(x), x[3:6], x[9:12]).reshape(-1, UNKNOWNS)
        return np.concatenate([J, np.diag(trust)[12:]])

    found = least_squares(
        error,
        np.zeros(UNKNOWNS),
        derivative,
        method="trf",
        loss="cauchy" if robust else "linear",
        f_scale=ROBUST_PX,
        x_scale=STEPS,
        max_nfev=60,
        ftol=1e-9,
        xtol=1e-9,
    )
    _, X, Z, scale = unpack(found.x)
    return fit_at(views, X, Z, scale, _lens(found.x))
