"""Recordings played through librealsense's own pipeline: what a frame is, and what each fault of a stream leads to.

The times to detection that docs/camera.md states are asserted here.
"""

import time

import numpy as np
import pyrealsense2 as rs
import pytest
from recordings import (
    COLOR_CX,
    COLOR_CY,
    COLOR_F,
    COLOR_HEIGHT,
    COLOR_WIDTH,
    CX,
    CY,
    FPS,
    HEIGHT,
    OFFSET_DEPTH_TO_COLOR,
    T_CAM_TASK,
    WIDTH,
    F,
    plain_color,
    table_depth,
    write_recording,
)

from evg_app.cameras.realsense.camera import RealSenseCamera
from evg_app.cameras.realsense.start import Recording
from evg_app.clock import WallClock
from evg_app.config.files import load_camera
from evg_app.errors import BadInput, DeviceTimeout, HardwareError, Refused
from evg_app.geometry import transform_points
from evg_app.perception.health import depth_health

CLOCK = WallClock()
STALL_S = 0.6
"""`stall_s` in these tests."""
GAP_S = 1.5
"""How long a recording gives nothing at all."""
START_S = 0.3
"""What starting and stopping a pipeline takes."""
SLACK_S = 1.0
"""What a busy machine may add to a time to detection."""
FLAT = np.full((HEIGHT, WIDTH), 600, np.uint16)


def opened(path, repeat=False, report=lambda cause, text: None, **changes):
    """The camera of the shipped config on a recording."""
    config = load_camera("d435i")
    asked = config.realsense.model_copy(update={"stall_s": STALL_S, "average_frames": 1, **changes})
    config = config.model_copy(update={"realsense": asked})
    return RealSenseCamera(config, CLOCK, report, recording=Recording(path, repeat))


def test_depth_is_bit_exact_and_the_optics_are_the_streams(tmp_path):
    images = [np.full((HEIGHT, WIDTH), 500 + n, np.uint16) for n in range(12)]
    with opened(write_recording(tmp_path / "a.db3", images)) as camera:
        frame = camera.capture(after=0.0, timeout=3.0)
        K = frame.intrinsics
        assert camera.intrinsics == K
        assert (K.width, K.height, K.distortion) == (WIDTH, HEIGHT, ())
        assert [K.fx, K.cx, K.cy] == pytest.approx([F, CX, CY], abs=1e-4)
        assert frame.frame_id == "camera_depth_optical_frame"
        later = camera.capture(after=frame.stamp + 1.5 / FPS, timeout=3.0)
    assert len(np.unique(frame.depth)) == len(np.unique(later.depth)) == 1
    assert later.depth[0, 0] > frame.depth[0, 0] >= 500


def test_depth_scale_comes_from_the_stream(tmp_path):
    with opened(write_recording(tmp_path / "a.db3", [FLAT * 10] * 5, depth_units=0.0001)) as camera:
        frame = camera.capture(after=0.0, timeout=3.0)
    assert frame.depth_scale == pytest.approx(0.0001, rel=1e-6)
    assert np.median(frame.metres()) == pytest.approx(0.6, abs=1e-4)


def test_depth_to_colour_extrinsic_is_librealsenses(table_recording):
    pipeline, setup = rs.pipeline(), rs.config()
    setup.enable_device_from_file(str(table_recording), True)
    profile = pipeline.start(setup)
    between = profile.get_stream(rs.stream.depth).get_extrinsics_to(profile.get_stream(rs.stream.color))
    pipeline.stop()
    with opened(table_recording) as camera:
        T_color_depth = camera.T_color_depth
    point = [0.1, -0.2, 0.7]
    expected = rs.rs2_transform_point_to_point(between, point)
    assert transform_points(T_color_depth, point) == pytest.approx(expected, abs=1e-6)
    assert np.linalg.norm(T_color_depth[:3, 3] - OFFSET_DEPTH_TO_COLOR) < 1e-6


def test_aligned_colour_shows_what_the_depth_pixel_sees(tmp_path):
    ramp = np.zeros((COLOR_HEIGHT, COLOR_WIDTH, 3), np.uint8)
    ramp[..., 0], ramp[..., 1] = np.arange(COLOR_WIDTH) // 3, (np.arange(COLOR_HEIGHT) // 2)[:, None]
    with opened(write_recording(tmp_path / "a.db3", [FLAT] * 8, [ramp] * 8)) as camera:
        frame = camera.capture(after=0.0, timeout=3.0)
        T_color_depth = camera.T_color_depth
    u, v = np.array([300, 424, 560]), np.array([160, 240, 300])
    points = np.stack([(u - CX) / F * 0.6, (v - CY) / F * 0.6, np.full(3, 0.6)], axis=-1)
    x, y, z = transform_points(T_color_depth, points).T
    assert frame.color.shape == (HEIGHT, WIDTH, 3)
    seen = frame.color[v, u].astype(int)
    assert np.abs(seen[:, 0] - (COLOR_F * x / z + COLOR_CX) / 3).max() <= 1.0
    assert np.abs(seen[:, 1] - (COLOR_F * y / z + COLOR_CY) / 2).max() <= 1.0


def test_colour_by_itself_has_its_own_size_optics_and_frame(table_recording):
    with opened(table_recording) as camera:
        image = camera.capture_color(after=CLOCK.now(), timeout=3.0)
        assert image.stamp >= 0 and image.frame_id == "camera_color_optical_frame"
    assert image.color.shape == (COLOR_HEIGHT, COLOR_WIDTH, 3)
    assert (image.intrinsics.width, image.intrinsics.height) == (COLOR_WIDTH, COLOR_HEIGHT)
    assert image.intrinsics.fx == pytest.approx(COLOR_F)


def test_recording_without_colour_gives_depth_and_says_what_is_missing(tmp_path):
    with opened(write_recording(tmp_path / "a.db3", [FLAT] * 20, with_color=False)) as camera:
        assert camera.capture(after=0.0, timeout=3.0).color is None
        with pytest.raises(BadInput, match="no colour stream"):
            camera.capture_color(after=0.0, timeout=3.0)


def test_frames_taken_before_the_motion_ended_are_passed_over(table_recording):
    with opened(table_recording, repeat=True) as camera:
        camera.capture(after=0.0, timeout=3.0)
        time.sleep(0.3)
        after = CLOCK.now()
        frame = camera.capture(after=after, timeout=3.0)
    assert after <= frame.stamp <= CLOCK.now()


def test_dropped_frames_are_counted_and_passed_over(tmp_path):
    numbers = [0, 1, 2, 6, 7, 8, 9, 15, 16, 17, 18]
    play = [0.02 + n / FPS for n in numbers]
    path = write_recording(tmp_path / "a.db3", [FLAT] * len(numbers), numbers=numbers, play_at_s=play)
    with opened(path) as camera:
        stamps = [camera.capture(after=0.0, timeout=3.0).stamp for _ in range(5)]
        assert camera.dropped >= 3
    assert (np.diff(stamps) > 0).all()


def test_lost_colour_image_costs_the_colour_not_the_depth(tmp_path):
    color = [plain_color(n) if n < 3 else None for n in range(20)]
    with opened(write_recording(tmp_path / "a.db3", [FLAT] * 20, color)) as camera:
        frames = [camera.capture(after=0.0, timeout=3.0) for _ in range(5)]
    assert all((frame.depth == 600).all() for frame in frames)
    assert frames[-1].color is None


def test_short_stall_is_waited_out(tmp_path):
    play = [0.02 + n / FPS + (0.25 if n >= 5 else 0.0) for n in range(10)]
    heard = []
    path = write_recording(tmp_path / "a.db3", [FLAT + n for n in range(10)], play_at_s=play)
    with opened(path, report=lambda cause, text: heard.append(text)) as camera:
        while camera.capture(after=0.0, timeout=3.0).depth[0, 0] < 605:
            pass
    assert heard == []


def test_depth_that_stalls_while_colour_goes_on_restarts_the_stream_in_bounded_time_and_says_so(tmp_path):
    path = write_recording(tmp_path / "a.db3", [FLAT] * 10 + [None] * 90 + [FLAT])
    assert_restarted(path, STALL_S + SLACK_S)


def test_stall_of_everything_restarts_the_stream_in_bounded_time_and_says_so(tmp_path):
    play = [0.02 + n / FPS + (GAP_S if n >= 10 else 0.0) for n in range(20)]
    path = write_recording(tmp_path / "a.db3", [FLAT] * 20, play_at_s=play)
    assert_restarted(path, GAP_S + SLACK_S)  # a played file cannot be stopped within its gap


def assert_restarted(path, within_s):
    """A stall is noticed, said, and mended by another start."""
    heard = []
    with opened(path, report=lambda cause, text: heard.append((cause, text))) as camera:
        for _ in range(20):
            start = CLOCK.now()
            frame = camera.capture(after=start, timeout=3.0)
            assert frame.stamp >= start
            if heard:
                break
        assert CLOCK.now() - start < within_s
    assert heard[0][0] == "camera stall" and "no frame for 0.6 s" in heard[0][1]


def test_stream_that_never_starts_is_given_up_after_named_attempts(tmp_path, monkeypatch):
    monkeypatch.setattr("evg_app.cameras.realsense.connection.FIRST_FRAME", 0.3)
    path = write_recording(tmp_path / "a.db3", [None] * 60 + [FLAT])
    heard, start = [], CLOCK.now()
    with (
        pytest.raises(HardwareError, match=r"no frame in 3 attempts.*evg-app doctor --camera"),
        opened(path, report=lambda cause, text: heard.append(text)),
    ):
        pass
    assert CLOCK.now() - start < 3 * (0.3 + START_S) + SLACK_S
    assert [f"attempt {n} of 3" in text for n, text in enumerate(heard, 1)] == [True] * 3


def test_stream_that_ends_for_good_is_a_hardware_error_in_bounded_time(tmp_path):
    with opened(write_recording(tmp_path / "a.db3", [FLAT] * 8)) as camera, pytest.raises(HardwareError, match="ended"):
        while True:
            start = CLOCK.now()
            camera.capture(after=0.0, timeout=3.0)
    assert CLOCK.now() - start < STALL_S + SLACK_S


def test_frozen_device_that_repeats_one_frame_is_not_fresh(tmp_path):
    path = write_recording(tmp_path / "a.db3", [FLAT] * 60, numbers=[1] * 60, stamps_s=[5.0] * 60)
    with opened(path) as camera:
        camera.capture(after=0.0, timeout=3.0)
        start = CLOCK.now()
        with pytest.raises(DeviceTimeout, match="a fresh frame"):
            camera.capture(after=0.0, timeout=0.9 * STALL_S)
        assert CLOCK.now() - start < STALL_S + SLACK_S


def test_all_zero_depth_arrives_and_is_refused_by_its_health(tmp_path):
    with opened(write_recording(tmp_path / "a.db3", [FLAT * 0] * 8)) as camera:
        frame = camera.capture(after=0.0, timeout=3.0)
    assert not frame.depth.any()
    with pytest.raises(Refused, match="without depth"):
        depth_health(frame, T_CAM_TASK).require()


def test_saturated_and_out_of_range_depth_is_no_measurement(tmp_path):
    image = np.rint(table_depth()).astype(np.uint16)
    image[:100] = 65535
    image[100:120] = 30
    image[120:140] = 2500
    with opened(write_recording(tmp_path / "a.db3", [image] * 8)) as camera:
        frame = camera.capture(after=0.0, timeout=3.0)
    assert not frame.depth[:140].any()
    assert np.array_equal(frame.depth[140:], image[140:])
    assert np.isfinite(frame.metres()).all()


def test_merged_frames_are_quieter_and_keep_the_first_stamp(table_recording):
    exact = table_depth() * 0.001
    with opened(table_recording, repeat=True) as camera:
        single = camera.capture(after=0.0, timeout=3.0)
    with opened(table_recording, repeat=True, average_frames=8) as camera:
        after = CLOCK.now()
        merged = camera.capture(after=after, timeout=5.0)
        assert CLOCK.now() - merged.stamp > 6 / FPS
    seen = (exact > 0.3) & (exact < 1.0)
    noise = [float(np.std((frame.metres() - exact)[seen & (frame.depth > 0)])) for frame in (single, merged)]
    assert noise[1] < noise[0] / 2
    assert merged.stamp >= after and merged.intrinsics == single.intrinsics


def test_smoothing_filter_keeps_holes_open(tmp_path):
    image = np.rint(table_depth()).astype(np.uint16)
    image[200:260, 400:460] = 0
    config = load_camera("d435i").realsense.model_validate({"spatial": {}})
    with opened(write_recording(tmp_path / "a.db3", [image] * 8), spatial=config.spatial) as camera:
        frame = camera.capture(after=0.0, timeout=3.0)
    assert not frame.depth[210:250, 410:450].any()
    rest = image[300:450] > 0
    assert np.abs(frame.metres()[300:450] - image[300:450] * 0.001)[rest].max() < 0.005


@pytest.mark.parametrize("content", [None, b"not a recording" * 100])
def test_unusable_recording_is_bad_input_with_the_command_that_makes_one(tmp_path, content):
    path = tmp_path / "broken.db3"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BadInput, match=r"broken\.db3 cannot be played.*evg-app camera record"):
        opened(path).__enter__()


def test_truncated_recording_is_bad_input(table_recording, tmp_path):
    path = tmp_path / "half.db3"
    path.write_bytes(table_recording.read_bytes()[: table_recording.stat().st_size // 2])
    with pytest.raises(BadInput, match="cannot be played"):
        opened(path).__enter__()


def test_camera_that_is_not_open_gives_no_frame_and_can_be_opened_again(table_recording):
    camera = opened(table_recording)
    for _ in range(2):
        with pytest.raises(HardwareError, match="not open"):
            camera.capture(after=0.0, timeout=1.0)
        with camera:
            camera.capture(after=0.0, timeout=3.0)
