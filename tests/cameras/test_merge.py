"""Merging depth images: less noise, no invented surface."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evg_app.cameras.merge import MAX_SPREAD, UNIT, DepthMerger


def merged(*images, scale=0.001):
    """The merged image in metres."""
    merger = DepthMerger()
    for image in images:
        merger.add(np.asarray(image, dtype=np.uint16))
    depth, unit = merger.result(scale)
    assert unit == UNIT and depth.dtype == np.uint16
    return depth * unit


@given(st.lists(st.integers(500, 510), min_size=1, max_size=9))
def test_mean_of_agreeing_measurements(values):
    assert merged(*[[[v]] for v in values])[0, 0] == pytest.approx(np.mean(values) * 1e-3, abs=UNIT)


def test_missing_measurements_do_not_pull_towards_zero():
    assert merged([[600]], [[0]], [[602]])[0, 0] == pytest.approx(0.601, abs=UNIT)


def test_pixel_that_is_mostly_missing_is_missing():
    assert merged([[600]], [[0]], [[0]])[0, 0] == 0
    assert merged([[0]], [[0]])[0, 0] == 0


def test_flickering_edge_is_no_measurement():
    step = int(600 * MAX_SPREAD * 2)
    assert merged([[600]], [[600 + step]])[0, 0] == 0


def test_depth_beyond_the_unit_is_no_measurement():
    assert merged([[7000]], [[7000]])[0, 0] == 0


def test_noise_falls_with_the_root_of_the_number():
    rng = np.random.default_rng(0)
    images = [np.rint(6000 + rng.normal(0, 20, (100, 100))) for _ in range(16)]
    assert np.std(merged(*images, scale=1e-4)) == pytest.approx(0.002 / 4, rel=0.1)
