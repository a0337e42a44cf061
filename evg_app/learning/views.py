"""Noisy single-view TSDF grids of a scene, casting only the pixels that some voxel needs (learning.md §1)."""

from dataclasses import replace

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
ROW_OFFSET_SHARE = 0.5
"""Share of the views seen one pixel row off, as by the published simulators' renderer (learning.md §1)."""


def noisy_grid(
    caster: SceneCaster, T_task_cam: Array, noise: str, rng: np.random.Generator, row_offset: int = 0
) -> NDArray[np.float32]:
    """TSDF values (40, 40, 40) of one noisy D435i image with 1 mm depth steps, as the simulated camera gives it.

    `row_offset`: the image shows at row v what belongs to v + row_offset.
    """
    T_cam_task = invert(T_task_cam)
    flat = _needed_pixels(T_cam_task)
    pixels = np.stack([flat % D435I.width, flat // D435I.width], axis=1)
    seen = replace(D435I, cy=D435I.cy - row_offset)
    depth = caster.depth_at(seen, T_task_cam, pixels)
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
    """Eight (view, noise) pairs: five of the side view and one of each random recipe, in random pairing."""
    first, second, third = (str(name) for name in rng.permutation(sorted(RANDOM_VIEWS)))
    side = tuple(("side", noise) for noise in ("gamma", "gaussian", "field", "gamma", "gamma"))
    return (*side, (first, "gamma"), (second, "gaussian"), (third, "gaussian"))


def scene_grids(
    caster: SceneCaster, views: tuple[tuple[str, str], ...], rng: np.random.Generator
) -> NDArray[np.float32]:
    """TSDF values of several (view, noise) pairs of one scene. Shape (V, 40, 40, 40)."""
    return np.stack(
        [
            noisy_grid(caster, draw_view(view, rng), noise, rng, row_offset=int(rng.random() < ROW_OFFSET_SHARE))
            for view, noise in views
        ]
    )
