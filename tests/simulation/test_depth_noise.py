"""Depth noise models: statistics of spec §4.4, and pixels agree with images."""

import numpy as np
import pytest

from evg_app.errors import UnknownName
from evg_app.simulation.noise import NOISE_MODELS, add_noise

MEAN_TOLERANCE, STD_TOLERANCE = 0.002, 0.002
SHAPE = (48, 64)


def test_gamma_factor_has_mean_one_and_the_published_spread():
    rng = np.random.default_rng(0)
    one = np.ones((8, 8), dtype=np.float32)
    means = np.array([np.median(add_noise("gamma", one, rng)) for _ in range(4000)])
    assert means.mean() == pytest.approx(1.0, abs=MEAN_TOLERANCE)
    assert means.std() == pytest.approx(0.0316, abs=STD_TOLERANCE)


def test_half_of_gamma_images_carry_a_smooth_field_of_millimetres():
    rng = np.random.default_rng(1)
    flat = np.full(SHAPE, 0.6, dtype=np.float32)
    spreads = np.array([add_noise("dex", flat, rng).std() for _ in range(400)])
    smooth = spreads > 1e-4
    assert 0.42 < smooth.mean() < 0.58
    assert 0.002 < spreads[smooth].mean() < 0.005


def test_gaussian_noise_is_eight_tenths_of_a_millimetre():
    noisy = add_noise("gaussian", np.full((200, 200), 0.6, dtype=np.float32), np.random.default_rng(2))
    assert noisy.std() == pytest.approx(0.0008, rel=0.03)
    assert noisy.mean() == pytest.approx(0.6, abs=5e-5)


@pytest.mark.parametrize("model", NOISE_MODELS)
def test_no_measurement_stays_no_measurement(model):
    depth = np.zeros(SHAPE, dtype=np.float32)
    depth[10:20, 10:20] = 0.5
    noisy = add_noise(model, depth, np.random.default_rng(3))
    np.testing.assert_array_equal(noisy == 0, depth == 0)
    assert noisy.dtype == np.float32


@pytest.mark.parametrize("seed", range(4))
def test_noise_at_pixels_equals_noise_of_the_image(seed):
    depth = np.random.default_rng(9).uniform(0.4, 0.8, SHAPE).astype(np.float32)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)[::5]
    at_pixels = depth[pixels[:, 1], pixels[:, 0]]
    whole = add_noise("gamma", depth, np.random.default_rng(seed))
    some = add_noise("gamma", at_pixels, np.random.default_rng(seed), pixels, SHAPE)
    np.testing.assert_allclose(some, whole[pixels[:, 1], pixels[:, 0]], atol=1e-6)


def test_unknown_model_lists_the_known_ones():
    with pytest.raises(UnknownName, match="gaussian"):
        add_noise("stereo", np.ones(SHAPE, dtype=np.float32), np.random.default_rng(0))
