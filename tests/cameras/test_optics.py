"""Optics from librealsense: every distortion model ends as the forward one that evg-app projects with."""

import numpy as np
import pyrealsense2 as rs
import pytest

from evg_app.cameras.realsense.optics import intrinsics_of

PIXEL = 0.05
"""How far the fitted forward model may be from librealsense's inverse one [px]."""


def lens(model, coefficients):
    """A colour lens."""
    made = rs.intrinsics()
    made.width, made.height, made.fx, made.fy, made.ppx, made.ppy = 1280, 720, 910.0, 909.0, 641.0, 357.0
    made.model, made.coeffs = model, list(coefficients)
    return made


def project(K, ray):
    """As `evg_app.perception.projection` does. Shape (2,)."""
    x, y = ray[0] / ray[2], ray[1] / ray[2]
    k1, k2, p1, p2, k3 = (*K.distortion, 0, 0, 0, 0, 0)[:5]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
    return np.array([u * K.fx + K.cx, v * K.fy + K.cy])


@pytest.mark.parametrize("model", [rs.distortion.brown_conrady, rs.distortion.inverse_brown_conrady])
def test_lens_without_distortion_has_none(model):
    assert intrinsics_of(rs, lens(model, [0.0] * 5)).distortion == ()


def test_forward_model_is_taken_over():
    coefficients = (0.1, -0.2, 0.001, -0.002, 0.05)
    K = intrinsics_of(rs, lens(rs.distortion.brown_conrady, coefficients))
    assert K.distortion == pytest.approx(coefficients)
    for ray in ([0.1, 0.2, 1.0], [-0.5, 0.3, 1.0]):
        expected = rs.rs2_project_point_to_pixel(lens(rs.distortion.brown_conrady, coefficients), ray)
        assert project(K, ray) == pytest.approx(expected, abs=1e-3)


def test_inverse_model_is_turned_round():
    raw = lens(rs.distortion.inverse_brown_conrady, (0.02, -0.03, 0.0005, -0.0004, 0.01))
    K = intrinsics_of(rs, raw)
    assert any(K.distortion)
    for pixel in ([30.0, 20.0], [641.0, 357.0], [900.0, 500.0], [1250.0, 700.0]):
        ray = rs.rs2_deproject_pixel_to_point(raw, pixel, 1.0)
        assert project(K, ray) == pytest.approx(pixel, abs=PIXEL)
