"""The TSDF is the reference's: conformance checks 1 and 2 of spec §11, equality with Open3D, masks, timing."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evg_app.errors import BadInput
from evg_app.geometry import camera_on_sphere, invert, look_at, to_quaternion
from evg_app.perception.projection import voxel_pixels
from evg_app.perception.tsdf import TsdfFusion, fuse, fuse_depth
from evg_app.types import Frame, Intrinsics

VALUE_TOLERANCE = 1e-3
BORDER_VOXELS = 8
"""Voxels per noise image that fall on a pixel border within float32 and may read the neighbour (of 64,000)."""
TIME_BOUND = 0.025
"""[s], median; measured 3 ms; generous because test machines are shared."""

D435I = Intrinsics(848, 480, 426.678, 426.67822, 427.25256, 234.44296)
SIDE_VIEW = invert(camera_on_sphere([0.15, 0.15, 0.1], 0.6, np.deg2rad(60), np.deg2rad(-90)))
TOP_VIEW = invert(look_at([0.15, 0.15, 0.6], [0.15, 0.15, 0.0], up=[0, 1, 0]))


def open3d_grid(depths, T_cam_task):
    """The same grid by Open3D's UniformTSDFVolume, with the ExtractVoxelGrid rule of spec §1."""
    o3d = pytest.importorskip("open3d", exc_type=ImportError)
    volume = o3d.pipelines.integration.UniformTSDFVolume(
        length=0.3,
        resolution=40,
        sdf_trunc=0.03,
        color_type=o3d.pipelines.integration.TSDFVolumeColorType.NoColor,
    )
    c = D435I
    camera = o3d.camera.PinholeCameraIntrinsic(c.width, c.height, c.fx, c.fy, c.cx, c.cy)
    for depth, T in zip(depths, T_cam_task, strict=True):
        image = o3d.geometry.Image(np.ascontiguousarray(depth))
        color = o3d.geometry.Image(np.zeros_like(depth))
        rgbd = o3d.geometry.RGBDImage.create_from_color_and_depth(
            color, image, depth_scale=1.0, depth_trunc=2.0, convert_rgb_to_intensity=False
        )
        volume.integrate(rgbd, camera, T)
    f, weight = np.asarray(volume.extract_volume_tsdf()).T
    return np.where((weight != 0) & (f < 0.98) & (f >= -0.98), (f + 1) * 0.5, 0).reshape(40, 40, 40)


def plane_depth(T_cam_task, height=0.05):
    """Depth [m] of the plane z = height of the task frame, by ray intersection."""
    v, u = np.mgrid[0 : D435I.height, 0 : D435I.width]
    rays = np.stack([(u - D435I.cx) / D435I.fx, (v - D435I.cy) / D435I.fy, np.ones_like(u, dtype=float)], axis=-1)
    T_task_cam = invert(T_cam_task)
    down = (rays @ T_task_cam[:3, :3].T)[..., 2]
    depth = np.where(down < -1e-6, (height - T_task_cam[2, 3]) / down, 0.0)
    return np.where((depth > 0) & (depth < 2.0), depth, 0).astype(np.float32)


def random_view(rng):
    """T_cam_task of a random camera on the upper half sphere."""
    return invert(camera_on_sphere([0.15, 0.15, 0.1], 0.6, rng.uniform(0.5, 1.3), rng.uniform(0, 6.28)))


def test_plane_seen_from_above_gives_the_column_of_conformance_check_1():
    values = fuse_depth(plane_depth(TOP_VIEW), D435I, TOP_VIEW).values
    expected = np.zeros(40)
    expected[3:11] = [0.104, 0.229, 0.354, 0.479, 0.604, 0.729, 0.854, 0.979]
    assert values[20, 20] == pytest.approx(expected, abs=VALUE_TOLERANCE)


def test_side_view_extrinsic_is_that_of_conformance_check_2():
    assert SIDE_VIEW[:3, 3] == pytest.approx([-0.15, 0.1616, 0.5201], abs=1e-4)
    q = to_quaternion(SIDE_VIEW)
    assert q * np.sign(q[3]) * -1 == pytest.approx([-0.866, 0, 0, -0.5], abs=1e-3)
    assert invert(SIDE_VIEW)[:3, 3] == pytest.approx([0.15, -0.3696, 0.4], abs=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_equals_open3d_on_a_noisy_tilted_plane(seed):
    rng = np.random.default_rng(seed)
    T = random_view(rng)
    depth = (plane_depth(T) * rng.normal(1, 0.002, (480, 848))).astype(np.float32)
    different = np.abs(fuse_depth(depth, D435I, T).values - open3d_grid([depth], [T])) > VALUE_TOLERANCE
    assert different.sum() <= BORDER_VOXELS


def test_equals_open3d_on_white_noise_depth_with_holes():
    rng = np.random.default_rng(7)
    T = random_view(rng)
    depth = rng.uniform(0.3, 2.4, (480, 848)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = 0
    ours, theirs = fuse_depth(depth, D435I, T).values, open3d_grid([depth], [T])
    assert (ours > 0).sum() > 500
    assert (np.abs(ours - theirs) > VALUE_TOLERANCE).sum() <= BORDER_VOXELS


def test_equals_open3d_when_three_views_are_fused():
    rng = np.random.default_rng(3)
    views = [random_view(rng) for _ in range(3)]
    depths = [plane_depth(T, 0.05 + 0.004 * i) for i, T in enumerate(views)]
    fusion = TsdfFusion()
    for depth, T in zip(depths, views, strict=True):
        fusion.add(depth, D435I, T)
    different = np.abs(fusion.grid().values - open3d_grid(depths, views)) > VALUE_TOLERANCE
    assert different.sum() <= 3 * BORDER_VOXELS


def test_uint16_depth_gives_the_same_grid_as_metres():
    millimetres = (plane_depth(SIDE_VIEW) * 1000).round().astype(np.uint16)
    frame = Frame(millimetres, 0.001, D435I, 0.0, "cam")
    assert np.array_equal(fuse([(frame, SIDE_VIEW)]).values, fuse_depth(frame.metres(), D435I, SIDE_VIEW).values)


def test_observed_tells_seen_free_space_from_unknown():
    grid = fuse_depth(plane_depth(TOP_VIEW), D435I, TOP_VIEW)
    above, below = grid.observed[20, 20, 12:], grid.observed[20, 20, :2]
    assert above.all() and (grid.values[20, 20, 12:] == 0).all()
    assert not below.any() and (grid.values[20, 20, :2] == 0).all()


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
def test_values_stay_in_the_band_and_only_where_observed(seed):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0, 1.2, (480, 848)).astype(np.float32)
    grid = fuse_depth(depth, D435I, random_view(rng))
    band = grid.values > 0
    assert grid.observed[band].all()
    assert grid.values.dtype == np.float32 and grid.values.shape == (40, 40, 40)
    assert grid.values[band].min() >= 0.0099 and grid.values.max() < 0.9901


def test_pixels_that_no_voxel_projects_to_do_not_matter():
    pixels = voxel_pixels(D435I, SIDE_VIEW).unique_pixels()
    depth = plane_depth(SIDE_VIEW)
    sparse = np.zeros(depth.size, np.float32)
    sparse[pixels] = depth.ravel()[pixels]
    assert len(pixels) < depth.size / 4
    full = fuse_depth(depth, D435I, SIDE_VIEW).values
    assert np.array_equal(fuse_depth(sparse.reshape(depth.shape), D435I, SIDE_VIEW).values, full)


def test_lens_distortion_moves_the_pixels_as_opencv_defines_it():
    k1, k2, p1, p2, k3 = coefficients = (0.1, -0.05, 0.002, -0.001, 0.01)
    pixels = voxel_pixels(Intrinsics(848, 480, 426.0, 426.0, 427.0, 234.0, coefficients), SIDE_VIEW)
    index = np.ravel_multi_index((33, 7, 12), (40, 40, 40))
    x, y, z = SIDE_VIEW[:3, :3] @ ((np.array([33, 7, 12]) + 0.5) * 0.0075) + SIDE_VIEW[:3, 3]
    x, y = x / z, y / z
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) * 426 + 427
    v = (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) * 426 + 234
    assert pixels.pixel[index] == int(v + 0.5) * 848 + int(u + 0.5)


def test_nothing_fused_and_unusable_images_are_refused_with_words():
    with pytest.raises(BadInput, match=r"TsdfFusion\.add"):
        TsdfFusion().grid()
    with pytest.raises(BadInput, match="depth_scale"):
        fuse_depth(np.zeros((480, 848), np.uint16), D435I, SIDE_VIEW)
    with pytest.raises(BadInput, match="shape"):
        fuse_depth(np.zeros((480, 640), np.float32), D435I, SIDE_VIEW)


@pytest.mark.parametrize(("dtype", "scale"), [(np.float32, None), (np.uint16, 0.001)])
def test_one_frame_is_fused_and_read_in_milliseconds(dtype, scale):
    depth = (plane_depth(SIDE_VIEW) / (scale or 1.0)).astype(dtype)
    times = []
    for _ in range(15):
        start = time.perf_counter()
        fuse_depth(depth, D435I, SIDE_VIEW, scale)
        times.append(time.perf_counter() - start)
    assert np.median(times) < TIME_BOUND
