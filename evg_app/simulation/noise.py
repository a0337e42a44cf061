"""Depth noise models (spec §4.4) as pure functions; depth 0 (no measurement) stays 0.

"gamma" (also "dex"): one factor Gamma(1000, 0.001) for the whole image, and half the time a smooth Gaussian field.
"field": the gamma model without its common factor, which is what the table as a ruler leaves of it.
"gaussian" (also "norm"): independent N(0, 0.8 mm) at every pixel. "none": as rendered.
"""

import numpy as np
from numpy.typing import NDArray

from evg_app.errors import UnknownName
from evg_app.geometry import Array

Depth = NDArray[np.float32]
Pixels = NDArray[np.int64]

GAMMA_SHAPE, GAMMA_SCALE = 1000.0, 0.001
"""Of the global factor: mean 1, standard deviation 0.0316."""
FIELD_PROBABILITY, FIELD_SIGMA, FIELD_STEP = 0.5, 0.005, 4
"""The smooth field: how often, standard deviation [m], pixels between its nodes."""
GAUSSIAN_SIGMA = 0.0008
"""Of the "gaussian" model [m]."""
NOISE_MODELS = ("gamma", "field", "gaussian", "none")


def add_noise(
    model: str,
    depth: Depth,
    rng: np.random.Generator,
    pixels: Pixels | None = None,
    image_shape: tuple[int, int] | None = None,
) -> Depth:
    """Noisy copy of a depth image [m].

    `depth` is an image (H, W), or the depths (N,) of the pixels (N, 2) given as (column, row) of an image (H, W).

    Raises:
        UnknownName: no such model.
    """
    if model not in (*NOISE_MODELS, "dex", "norm"):
        raise UnknownName("depth noise", model, list(NOISE_MODELS))
    noisy = depth.astype(np.float64)
    if model in ("gamma", "dex", "field"):
        if model != "field":
            noisy *= rng.gamma(GAMMA_SHAPE, GAMMA_SCALE)
        if rng.random() < FIELD_PROBABILITY:
            noisy += _smooth_field(rng, depth, pixels, image_shape)
    elif model in ("gaussian", "norm"):
        noisy += rng.normal(0.0, GAUSSIAN_SIGMA, depth.shape)
    return np.where(depth > 0, np.maximum(noisy, 0.0), 0.0).astype(np.float32)


def _smooth_field(
    rng: np.random.Generator, depth: Depth, pixels: Pixels | None, image_shape: tuple[int, int] | None
) -> Array:
    height, width = image_shape or depth.shape
    nodes = rng.normal(0.0, FIELD_SIGMA, (height // FIELD_STEP, width // FIELD_STEP))
    if pixels is None:
        along_rows = _weights(height, nodes.shape[0]) @ nodes
        full: Array = along_rows @ _weights(width, nodes.shape[1]).T
        return full
    return _bilinear(nodes, pixels, (int(height), int(width)))


def _coordinates(pixel: NDArray[np.int64], size: int, count: int) -> Array:
    """Where pixel centres fall among `count` nodes spread evenly over `size` pixels."""
    place: Array = (pixel.astype(np.float64) + 0.5) * (count / size) - 0.5
    return place


def _weights(size: int, count: int) -> Array:
    """Matrix of linear interpolation weights, nodes outside being zero. Shape (size, count)."""
    x = _coordinates(np.arange(size), size, count)
    weights: Array = np.maximum(0.0, 1.0 - np.abs(x[:, None] - np.arange(count)[None, :]))
    return weights


def _bilinear(nodes: Array, pixels: Pixels, shape: tuple[int, int]) -> Array:
    padded = np.pad(nodes, 1)
    x = _coordinates(pixels[:, 0], shape[1], nodes.shape[1]) + 1.0
    y = _coordinates(pixels[:, 1], shape[0], nodes.shape[0]) + 1.0
    i, j = np.floor(y).astype(np.int64), np.floor(x).astype(np.int64)
    a, b = y - i, x - j
    value: Array = (1 - a) * ((1 - b) * padded[i, j] + b * padded[i, j + 1])
    value += a * ((1 - b) * padded[i + 1, j] + b * padded[i + 1, j + 1])
    return value
