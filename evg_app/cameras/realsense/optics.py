"""Intrinsics and extrinsics of librealsense as values of evg-app."""

from typing import Any

import numpy as np

from evg_app.geometry import Array, make
from evg_app.types import Intrinsics

GRID = 15
"""Points along each side of the image over which an inverse distortion is turned round."""


def intrinsics_of(rs: Any, raw: Any) -> Intrinsics:
    """Pinhole model with forward Brown-Conrady distortion, empty when the image has none."""
    flat = not any(raw.coeffs) or raw.model == rs.distortion.none
    if flat:
        coefficients: tuple[float, ...] = ()
    elif raw.model == rs.distortion.brown_conrady:
        coefficients = tuple(float(c) for c in raw.coeffs)
    else:
        coefficients = forward_distortion(rs, raw)
    return Intrinsics(raw.width, raw.height, raw.fx, raw.fy, raw.ppx, raw.ppy, coefficients)


def forward_distortion(rs: Any, raw: Any) -> tuple[float, ...]:
    """k1 k2 p1 p2 k3 that distort as `raw` does, whatever model it uses, by least squares over the image.

    D400 colour streams come with the inverse model, which maps the other way.
    """
    columns, rows = np.linspace(0, raw.width - 1, GRID), np.linspace(0, raw.height - 1, GRID)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    rays = np.array([rs.rs2_deproject_pixel_to_point(raw, pixel.tolist(), 1.0)[:2] for pixel in pixels])
    x, y = rays.T
    r2 = x * x + y * y
    zero = np.zeros_like(x)
    across = np.stack([x * r2, x * r2**2, 2 * x * y, r2 + 2 * x * x, x * r2**3], axis=1)
    down = np.stack([y * r2, y * r2**2, r2 + 2 * y * y, 2 * x * y, y * r2**3], axis=1)
    target = np.concatenate([(pixels[:, 0] - raw.ppx) / raw.fx - x, (pixels[:, 1] - raw.ppy) / raw.fy - y])
    solved = np.linalg.lstsq(np.concatenate([across, down]), target + np.concatenate([zero, zero]), rcond=None)[0]
    return tuple(float(c) for c in solved)


def transform_of(extrinsics: Any) -> Array:
    """T_to_from of librealsense's extrinsics (rotation in column order). Shape (4, 4)."""
    return make(np.reshape(extrinsics.rotation, (3, 3)).T, extrinsics.translation)
