"""The collision volume marks what is seen, knows what is free, and leaves the rest unknown."""

import time

import numpy as np
import pytest

from evg_app.errors import BadInput
from evg_app.geometry import invert, look_at, rotation_about, transform_points, translation
from evg_app.perception.volume import VolumeFusion, fuse_volume, volume_origin
from evg_app.types import Frame, Intrinsics

TIME_BOUND = 0.06
"""[s], median; measured about 9 ms."""

CAMERA = Intrinsics(848, 480, 426.678, 426.67822, 427.25256, 234.44296)
T_BASE_TASK = translation(0.3, -0.15, 0.1) @ rotation_about("z", 0.3)
CENTRE = transform_points(T_BASE_TASK, [0.15, 0.15, 0.0])
T_CAM_BASE = invert(look_at(transform_points(translation(0, 0, 0.8), CENTRE), CENTRE, up=[1, 0, 0]))


def top_frame(block_height=0.0):
    """A table at z = 0.1425 of the base frame seen from above, with a block in the image's middle."""
    depth = np.full((480, 848), 0.9 - 0.1425, np.float32)
    if block_height:
        depth[200:270, 390:460] -= block_height
    return Frame((depth * 10_000).round().astype(np.uint16), 1e-4, CAMERA, 0.0, "cam")


def voxel_of(volume, point):
    """Index of the voxel that holds a base-frame point [m]."""
    return tuple(np.floor((np.asarray(point) - volume.origin) / volume.voxel_size).astype(int))


def test_it_is_at_least_0_8_m_wide_and_centred_on_the_workspace():
    volume = fuse_volume([(top_frame(), T_CAM_BASE)], T_BASE_TASK)
    side = np.array(volume.occupied.shape) * volume.voxel_size
    assert (side >= 0.8 - 1e-9).all()
    assert (volume.origin + side / 2)[:2] == pytest.approx(CENTRE[:2])
    assert volume.origin[2] < T_BASE_TASK[2, 3]


def test_surface_is_occupied_above_is_free_below_is_unknown():
    volume = fuse_volume([(top_frame(0.1), T_CAM_BASE)], T_BASE_TASK)
    top_of_block, above, inside = (voxel_of(volume, [*CENTRE[:2], z]) for z in (0.2425, 0.3, 0.2))
    assert volume.occupied[top_of_block] and volume.observed[top_of_block]
    assert volume.observed[above] and not volume.occupied[above]
    assert not volume.observed[inside] and not volume.occupied[inside]
    table = voxel_of(volume, [CENTRE[0] + 0.2, CENTRE[1], 0.1425])
    assert volume.occupied[table]


def test_several_views_add_up():
    fusion = VolumeFusion(volume_origin(T_BASE_TASK))
    fusion.add_frame(top_frame(), T_CAM_BASE)
    one = fusion.volume()
    fusion.add_frame(top_frame(0.1), T_CAM_BASE)
    two = fusion.volume()
    assert (two.occupied | ~one.occupied).all() and (two.observed | ~one.observed).all()
    assert two.occupied.sum() > one.occupied.sum()


def test_a_single_stray_pixel_does_not_block_the_arm():
    clean, stray = top_frame(), top_frame()
    stray.depth[240, 424] -= 3000
    a = fuse_volume([(clean, T_CAM_BASE)], T_BASE_TASK)
    b = fuse_volume([(stray, T_CAM_BASE)], T_BASE_TASK)
    assert not (b.occupied & ~a.occupied).any()


def test_no_frame_is_refused():
    with pytest.raises(BadInput, match="no frame"):
        fuse_volume([], T_BASE_TASK)


def test_one_frame_takes_milliseconds():
    frame, times = top_frame(0.1), []
    for _ in range(9):
        start = time.perf_counter()
        fuse_volume([(frame, T_CAM_BASE)], T_BASE_TASK)
        times.append(time.perf_counter() - start)
    assert np.median(times) < TIME_BOUND
