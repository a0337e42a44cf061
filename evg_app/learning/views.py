"""Noisy single-view TSDF grids of a scene, casting only the pixels that some voxel needs (learning.md §1)."""

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import Array, invert
from evg_app.perception.projection import voxel_pixels
from evg_app.perception.tsdf import fuse_depth
from evg_app.simulation.noise import add_noise
from evg_app.simulation.rendering import SceneCaster
from evg_app.simulation.views import D435I, RANDOM_VIEWS, draw_view

DEPTH_UNIT = 0.001
"""Metres per unit of the simulated camera's uint16 depth."""


def noisy_grid(caster: SceneCaster, T_task_cam: Array, noise: str, rng: np.random.Generator) -> NDArray[np.float32]:
    """TSDF values (40, 40, 40) of one noisy D435i image with 1 mm depth steps, as the simulated camera gives it."""
    T_cam_task = invert(T_task_cam)
    flat = _needed_pixels(T_cam_task)
    pixels = np.stack([flat % D435I.width, flat // D435I.width], axis=1)
    depth = caster.depth_at(D435I, T_task_cam, pixels)
    noisy = add_noise(noise, depth, rng, pixels, (D435I.height, D435I.width))
    image = np.zeros(D435I.height * D435I.width, dtype=np.uint16)
    image[flat] = np.round(noisy / DEPTH_UNIT).astype(np.uint16)
    return fuse_depth(image.reshape(D435I.height, D435I.width), D435I, T_cam_task, DEPTH_UNIT).values


def _needed_pixels(T_cam_task: Array) -> NDArray[np.int64]:
    """Flat indices of the D435i's pixels that hold a voxel centre (as `VoxelPixels.unique_pixels`, without sorting)."""
    pixels = voxel_pixels(D435I, T_cam_task)
    needed = np.zeros(D435I.height * D435I.width, dtype=np.bool_)
    needed[pixels.pixel[pixels.inside]] = True
    return np.flatnonzero(needed)


def draw_views(rng: np.random.Generator) -> tuple[tuple[str, str], ...]:
    """Four (view, noise) pairs: the side view with both noises, and two random views of random recipes."""
    first, second = rng.choice(sorted(RANDOM_VIEWS), size=2, replace=False)
    return (("side", "gamma"), ("side", "gaussian"), (str(first), "gamma"), (str(second), "gaussian"))


def scene_grids(
    caster: SceneCaster, views: tuple[tuple[str, str], ...], rng: np.random.Generator
) -> NDArray[np.float32]:
    """TSDF values of several (view, noise) pairs of one scene. Shape (V, 40, 40, 40)."""
    return np.stack([noisy_grid(caster, draw_view(view, rng), noise, rng) for view, noise in views])
