"""Stored frames behind the camera protocol: none is lost, none is altered, and every end is an error with a name."""

import numpy as np
import pytest
from recordings import CX, FRAMES, HEIGHT, WIDTH, F, write_recording

from evg_app.cameras.factory import open_replay
from evg_app.clock import WallClock
from evg_app.config.files import load_camera
from evg_app.errors import BadInput, DeviceTimeout, HardwareError

CONFIG = load_camera("d435i")
LOST = 1
"""Frames at the start that librealsense's pipeline may keep until every stream has given one."""


def attempt(path, depth, **more):
    """An attempt's file, as `evg_app.trials.arrays` writes it."""
    np.savez_compressed(
        path,
        depth=depth,
        depth_scale=np.float64(0.001),
        stamp=np.float64(5.0),
        image_size=np.array([WIDTH, HEIGHT]),
        focal_centre=np.array([F, F, CX, 234.4]),
        distortion=np.zeros(0),
        **more,
    )


@pytest.fixture
def run_folder(tmp_path):
    (tmp_path / "attempts").mkdir()
    for n in range(3):
        color = np.full((HEIGHT, WIDTH, 3), n, np.uint8)
        attempt(
            tmp_path / "attempts" / f"s0-r000-a{n:02d}-x.npz", np.full((HEIGHT, WIDTH), 500 + n, np.uint16), color=color
        )
    np.savez_compressed(tmp_path / "attempts" / "s0-r000-a03-x.npz", chosen=np.array(-1))
    return tmp_path


def everything(camera):
    """All frames until the end."""
    frames = []
    with camera, pytest.raises(HardwareError, match="has ended after"):
        while True:
            frames.append(camera.capture(after=0.0, timeout=5.0))
    return frames


def test_recording_is_replayed_bit_exact_without_a_gap(tmp_path):
    images = [np.full((HEIGHT, WIDTH), 500 + n, np.uint16) for n in range(12)]
    frames = everything(open_replay(CONFIG, write_recording(tmp_path / "a.db3", images)))
    first = int(frames[0].depth[9, 9])
    assert first - 500 <= LOST
    assert [int(frame.depth[9, 9]) for frame in frames] == list(range(first, 512))
    assert all((frame.depth == frame.depth[0, 0]).all() for frame in frames)
    assert all(frame.color is not None for frame in frames)


def test_recording_has_as_many_frames_as_were_written(table_recording):
    assert FRAMES - LOST <= len(everything(open_replay(CONFIG, table_recording))) <= FRAMES


def test_attempts_of_a_run_are_replayed_in_order_and_those_without_a_frame_are_passed_over(run_folder):
    frames = everything(open_replay(CONFIG, run_folder))
    assert [int(frame.depth[0, 0]) for frame in frames] == [500, 501, 502]
    assert [int(frame.color[0, 0, 0]) for frame in frames] == [0, 1, 2]
    assert frames[0].intrinsics.fx == F and frames[0].frame_id == CONFIG.frame_id


def test_stamps_are_those_of_asking(run_folder):
    clock = WallClock()
    with open_replay(CONFIG, run_folder, clock=clock) as camera:
        after = clock.now() + 0.1
        first = camera.capture(after=after, timeout=1.0)
        second = camera.capture(after=0.0, timeout=1.0)
        assert after <= first.stamp < second.stamp <= clock.now()
        with pytest.raises(DeviceTimeout, match="too far ahead"):
            camera.capture(after=clock.now() + 9.0, timeout=0.1)


def test_repeating_replay_never_ends(run_folder):
    with open_replay(CONFIG, run_folder / "attempts", repeat=True) as camera:
        seen = [int(camera.capture(after=0.0, timeout=1.0).depth[0, 0]) for _ in range(7)]
    assert seen == [500, 501, 502, 500, 501, 502, 500]


def test_folder_that_is_no_run_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match=r"neither a \.db3 recording nor a folder"):
        open_replay(CONFIG, tmp_path / "nowhere")
    with pytest.raises(BadInput, match="holds no depth frame"):
        open_replay(CONFIG, tmp_path).__enter__()


def test_file_that_is_no_attempt_is_named(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"nothing")
    with pytest.raises(BadInput, match=r"a\.npz is not an attempt"):
        open_replay(CONFIG, tmp_path).__enter__()


def test_replay_that_is_not_open_gives_no_frame(run_folder):
    camera = open_replay(CONFIG, run_folder)
    for _ in range(2):
        with pytest.raises(HardwareError, match="not open"):
            camera.capture(after=0.0, timeout=1.0)
        with camera:
            camera.capture(after=0.0, timeout=1.0)
