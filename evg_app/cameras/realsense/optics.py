"""Intrinsics and extrinsics of librealsense as values of evg-app."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from evg_app.geometry import Array, make
from evg_app.types import Intrinsics

GRID = 15
"""Points along each side of the image over which an inverse distortion is turned round."""


@dataclass(frozen=True)
class Streams:
    """Optics and rate of what a pipeline gives.

    Attributes:
        depth: of the depth stream.
        depth_scale: metres per unit of raw depth [m].
        period: time between two frames [s].
        color: of the colour stream, None without one.
        T_color_depth: depth optical frame to colour optical frame (4, 4), None without colour.
    """

    depth: Intrinsics
    depth_scale: float
    period: float
    color: Intrinsics | None
    T_color_depth: Array | None


def streams_of(rs: Any, profile: Any) -> Streams:
    """The streams of a started pipeline.

    Raises:
        RuntimeError: there is no depth, or the optics are not known.
    """
    found = {
        stream.stream_type(): stream.as_video_stream_profile()
        for stream in profile.get_streams()
        if stream.is_video_stream_profile()
    }
    if rs.stream.depth not in found:
        raise RuntimeError("there is no depth stream")
    depth, color = found[rs.stream.depth], found.get(rs.stream.color)
    return Streams(
        intrinsics_of(rs, depth.get_intrinsics()),
        float(profile.get_device().first_depth_sensor().get_depth_scale()),
        1.0 / depth.fps(),
        None if color is None else intrinsics_of(rs, color.get_intrinsics()),
        None if color is None else transform_of(depth.get_extrinsics_to(color)),
    )


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
    across = np.stack([x * r2, x * r2**2, 2 * x * y, r2 + 2 * x * x, x * r2**3], axis=1)
    down = np.stack([y * r2, y * r2**2, r2 + 2 * y * y, 2 * x * y, y * r2**3], axis=1)
    target = np.concatenate([(pixels[:, 0] - raw.ppx) / raw.fx - x, (pixels[:, 1] - raw.ppy) / raw.fy - y])
    solved = np.linalg.lstsq(np.concatenate([across, down]), target, rcond=None)[0]
    return tuple(float(c) for c in solved)


def transform_of(extrinsics: Any) -> Array:
    """T_to_from of librealsense's extrinsics (rotation in column order). Shape (4, 4)."""
    return make(np.reshape(extrinsics.rotation, (3, 3)).T, extrinsics.translation)
