"""The table as a ruler for depth."""

import numpy as np
import pytest

from evg_app.geometry import TABLE_HEIGHT, camera_on_sphere, invert
from evg_app.perception.table import fit_table, rescale
from evg_app.types import Frame, Intrinsics

SCALE_ATOL = 1.5e-3
K = Intrinsics(848, 480, 426.678, 426.678, 427.25, 234.44)
T_TASK_CAM = camera_on_sphere((0.15, 0.15, 0.1), 0.6, np.deg2rad(60), np.deg2rad(-90))
T_CAM_TASK = invert(T_TASK_CAM)


def image(bias: float = 1.0, tilt_table: float = 0.0, box: float = 0.0) -> Frame:
    """Depth of the table (moved up by `tilt_table`) with a box of `box` [m] height on it, times `bias`, in mm."""
    u, v = np.meshgrid((np.arange(K.width) - K.cx) / K.fx, (np.arange(K.height) - K.cy) / K.fy)
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ T_TASK_CAM[:3, :3].T
    eye = T_TASK_CAM[:3, 3]
    depth = np.where(rays[..., 2] < -1e-3, (TABLE_HEIGHT + tilt_table - eye[2]) / np.minimum(rays[..., 2], -1e-3), 0.0)
    if box:
        top = (TABLE_HEIGHT + box - eye[2]) / np.minimum(rays[..., 2], -1e-3)
        at = eye + top[..., None] * rays
        depth = np.where(((at[..., :2] > 0.05) & (at[..., :2] < 0.25)).all(axis=-1), top, depth)
    depth[depth > 2.0] = 0.0
    noisy = depth * bias + np.random.default_rng(0).normal(0, 0.001, depth.shape) * (depth > 0)
    return Frame(np.rint(noisy / 0.001).astype(np.uint16), 0.001, K, 0.0, "cam")


@pytest.mark.parametrize("bias", [0.93, 0.97, 1.0, 1.04])
@pytest.mark.parametrize("box", [0.0, 0.12])
def test_common_factor_is_found_beside_objects(bias: float, box: float):
    fit = fit_table(image(bias, box=box), T_CAM_TASK)
    assert fit.seen
    assert fit.scale == pytest.approx(1 / bias, abs=SCALE_ATOL)


def test_rescaled_frame_shows_the_table_where_it_is():
    frame = image(1.05, box=0.1)
    again = fit_table(rescale(frame, fit_table(frame, T_CAM_TASK).scale), T_CAM_TASK)
    assert again.scale == pytest.approx(1.0, abs=SCALE_ATOL)
    assert again.noise < 0.002


def test_image_without_a_table_is_left_alone():
    frame = image()
    nothing = Frame(np.zeros_like(frame.depth), 0.001, K, 0.0, "cam")
    assert fit_table(nothing, T_CAM_TASK) == fit_table(Frame(frame.depth // 3, 0.001, K, 0.0, "cam"), T_CAM_TASK)
    assert not fit_table(nothing, T_CAM_TASK).seen
    assert fit_table(nothing, T_CAM_TASK).scale == 1.0


def test_raw_depth_is_never_touched():
    frame = image(1.05)
    assert rescale(frame, 0.95).depth is frame.depth
