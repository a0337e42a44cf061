"""Wrong intrinsics of the stream: measured, corrected, and named when they are grossly wrong."""

from dataclasses import replace

import numpy as np
import pytest

from evg_app.handeye import diagnose
from evg_app.handeye.hand_noise import polish
from evg_app.handeye.refine import SCALE_PRIOR, corrected, fit_at, lens_between, refine
from evg_app.handeye.rigid import cube_points, displacement

FOCAL, CENTRE_PX = 5e-4, 0.3
CUBE = cube_points(np.eye(4))


def test_a_wrong_focal_length_and_centre_are_found_and_do_no_harm(synthetic):
    views, X, Z = synthetic(count=24, noise=0.07)
    off = np.array([-0.006, 3.0, -2.0])
    told = replace(views, intrinsics=corrected(views.intrinsics, off))
    fit = polish(told, refine(told, fit_at(told, X, Z), SCALE_PRIOR), SCALE_PRIOR)
    assert fit.lens[0] == pytest.approx(-off[0], abs=FOCAL)
    assert fit.lens[1:] == pytest.approx(-off[1:], abs=CENTRE_PX)
    assert displacement(X, fit.X, CUBE) < 0.001


def test_only_a_gross_error_is_named():
    assert diagnose.lens(np.array([0.002, 1.0, -1.0])) == []
    (finding,) = diagnose.lens(np.array([0.01, 1.0, -1.0]))
    assert finding.cause == "lens" and "+1.0 %" in finding.text


def test_the_difference_of_two_lenses_is_the_opposite_of_correcting(lens):
    off = np.array([0.01, -2.0, 3.0])
    assert lens_between(lens, corrected(lens, off)) == pytest.approx(off)
