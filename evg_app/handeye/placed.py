"""Where the board is when the camera is known, or the camera when the board is."""

from typing import Literal

import numpy as np
from scipy.optimize import least_squares

from evg_app.geometry import Array, invert
from evg_app.handeye.refine import Fit, fit_at, residuals, through
from evg_app.handeye.rigid import mean_transform, moved
from evg_app.handeye.sample import Views

Part = Literal["camera", "board"]


def place(views: Views, fit: Fit, part: Part) -> Fit:
    """A fit of one part alone, with a robust loss; everything else is taken from `fit`."""
    B = views.B.copy()
    B[:, :3, 3] *= fit.scale
    camera = part == "camera"
    centre = mean_transform(views.A @ fit.Z @ invert(B) if camera else invert(views.A) @ fit.X @ B)
    seen = through(views, fit.lens)

    def pair(step: Array) -> tuple[Array, Array]:
        """Camera and board after a step (6,)."""
        return (moved(centre, step), fit.Z) if camera else (fit.X, moved(centre, step))

    def error(step: Array) -> Array:
        """Residuals after a step, in one row [px]."""
        return residuals(seen, *pair(step), fit.scale).ravel()

    found = least_squares(error, np.zeros(6), loss="soft_l1", x_scale=0.01)
    return fit_at(views, *pair(found.x), fit.scale, fit.lens)
