"""What the planner is given: one noisy depth image of the table, fused (spec §6.1)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evg_app.benchmark.clutter.config import VIEWS, BenchmarkConfig
from evg_app.geometry import Array, invert
from evg_app.perception.projection import voxel_pixels
from evg_app.perception.table import fit_table
from evg_app.perception.tsdf import fuse_depth
from evg_app.simulation.noise import add_noise
from evg_app.simulation.rendering import SceneCaster
from evg_app.simulation.state import SceneState
from evg_app.simulation.views import draw_view
from evg_app.types import Frame, Intrinsics

ROW_OFFSET = 1.0
"""The official renderer's image is one row off (row v shows what belongs to v + 1), and its reader does not know."""
CLOUD = np.array([[0.02, 0.28], [0.02, 0.28], [0.055, 0.30]])
"""The view is empty when no measured point lies in this box of the task frame [m]."""
RULER_UNIT = 5e-5
"""Depth unit of the image that is compared with the table [m]."""

Depth = NDArray[np.float32]


@dataclass(frozen=True)
class Observation:
    """One look at the table.

    Attributes:
        values: TSDF values (40, 40, 40).
        T_task_cam: where the camera was. Shape (4, 4).
        empty: nothing was seen above the table.
    """

    values: NDArray[np.float32]
    T_task_cam: Array
    empty: bool


def observe(
    config: BenchmarkConfig, state: SceneState, view_rng: np.random.Generator, noise_rng: np.random.Generator
) -> Observation:
    """Render, add noise, fuse. Only pixels that some voxel needs are rendered, which changes no value."""
    T_task_cam = draw_view(VIEWS[config.view], view_rng)
    depth = _noisy_depth(config, SceneCaster(state), T_task_cam, noise_rng)
    if config.table_ruler:
        depth = depth * np.float32(_table_scale(depth, config.intrinsics, T_task_cam))
    values = fuse_depth(depth, config.intrinsics, invert(T_task_cam)).values
    return Observation(values, T_task_cam, not _sees_objects(depth, config.intrinsics, T_task_cam))


def _noisy_depth(config: BenchmarkConfig, caster: SceneCaster, T_task_cam: Array, rng: np.random.Generator) -> Depth:
    """Depth image [m] with noise, 0 where no voxel needs it (but whole for the table as a ruler). Shape (H, W)."""
    K = config.intrinsics
    needed = voxel_pixels(K, invert(T_task_cam)).unique_pixels().astype(np.int64)
    flat = np.arange(K.width * K.height) if config.table_ruler else needed
    pixels = np.stack([flat % K.width, flat // K.width], axis=1)
    shifted = Intrinsics(K.width, K.height, K.fx, K.fy, K.cx, K.cy - ROW_OFFSET)
    clean = caster.depth_at(shifted, T_task_cam, pixels)
    image = np.zeros(K.width * K.height, dtype=np.float32)
    image[flat] = add_noise(config.noise, clean, rng, pixels, (K.height, K.width))
    return image.reshape(K.height, K.width)


def _sees_objects(depth: Depth, K: Intrinsics, T_task_cam: Array) -> bool:
    """Whether some pixel lies above the table in the workspace."""
    v, u = np.nonzero(depth)
    d = depth[v, u].astype(np.float64)
    points = np.stack([(u - K.cx) / K.fx * d, (v - K.cy) / K.fy * d, d], axis=1) @ T_task_cam[:3, :3].T
    points += T_task_cam[:3, 3]
    return bool(((points > CLOUD[:, 0]) & (points < CLOUD[:, 1])).all(axis=1).any())


def _table_scale(depth: Depth, K: Intrinsics, T_task_cam: Array) -> float:
    """The factor that brings the seen table to its known height."""
    raw = np.clip(np.rint(depth / RULER_UNIT), 0, np.iinfo(np.uint16).max).astype(np.uint16)
    frame = Frame(raw, RULER_UNIT, K, stamp=0.0, frame_id="benchmark")
    return fit_table(frame, invert(T_task_cam)).scale
