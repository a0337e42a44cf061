"""Recordings for tests: a software device of librealsense writes .db3 files that its own pipeline plays.

The times at which a recording gives its frames are set in the file afterwards: a long stall costs nothing to make.
"""

import sqlite3
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyrealsense2 as rs

from evg_app.geometry import TABLE_HEIGHT, invert, look_at

WIDTH, HEIGHT, FPS = 848, 480, 30
COLOR_WIDTH, COLOR_HEIGHT = 640, 360
F, CX, CY = 426.678, 427.25256, 234.44296
COLOR_F, COLOR_CX, COLOR_CY = 455.0, 321.5, 178.25
FRAMES = 20
SERIAL = "111222333444"
T_TASK_CAM = look_at([0.15, -0.25, 0.5], [0.15, 0.15, 0.05])
T_CAM_TASK = invert(T_TASK_CAM)
ROTATION_DEPTH_TO_COLOR = np.array([[0.9998, -0.02, 0.0], [0.02, 0.9998, 0.0], [0.0, 0.0, 1.0]])
OFFSET_DEPTH_TO_COLOR = np.array([0.0147, -0.0002, 0.0003])


def table_depth(scale_m: float = 0.001) -> np.ndarray:
    """Exact depth of the table top seen from `T_TASK_CAM`, in units of `scale_m`, 0 beyond 2 m. Shape (H, W)."""
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rays = np.stack([(u - CX) / F, (v - CY) / F, np.ones_like(u, dtype=float)], axis=-1) @ T_TASK_CAM[:3, :3].T
    depth = (TABLE_HEIGHT - T_TASK_CAM[2, 3]) / rays[..., 2]
    return np.where((depth > 0) & (depth < 2.0), depth / scale_m, 0.0)


def plain_color(number: int) -> np.ndarray:
    """A picture whose red tells its number."""
    return np.full((COLOR_HEIGHT, COLOR_WIDTH, 3), (number % 256, 80, 160), np.uint8)


def _intrinsics(width: int, height: int, f: float, cx: float, cy: float) -> rs.intrinsics:
    made = rs.intrinsics()
    made.width, made.height, made.fx, made.fy, made.ppx, made.ppy = width, height, f, f, cx, cy
    made.model, made.coeffs = rs.distortion.brown_conrady, [0.0] * 5
    return made


def _stream(kind, uid: int, intrinsics: rs.intrinsics, fmt, bpp: int) -> rs.video_stream:
    made = rs.video_stream()
    made.type, made.index, made.uid, made.fps, made.bpp, made.fmt = kind, 0, uid, FPS, bpp, fmt
    made.width, made.height, made.intrinsics = intrinsics.width, intrinsics.height, intrinsics
    return made


def _frame(profile, pixels: np.ndarray, bpp: int, stamp_ms: float, number: int) -> rs.software_video_frame:
    made = rs.software_video_frame()
    made.bpp, made.stride, made.pixels = bpp, bpp * pixels.shape[1], np.ascontiguousarray(pixels)
    made.timestamp, made.frame_number, made.profile = stamp_ms, number, profile.as_video_stream_profile()
    made.domain = rs.timestamp_domain.hardware_clock
    return made


def write_recording(
    path: Path,
    depth: Sequence[np.ndarray | None],
    color: Sequence[np.ndarray | None] | None = None,
    numbers: Sequence[int] | None = None,
    stamps_s: Sequence[float] | None = None,
    play_at_s: Sequence[float] | None = None,
    depth_units: float = 0.001,
    usb: str = "3.2",
    with_color: bool = True,
) -> Path:
    """Write uint16 depth images and colour images as a D435i would have; None is an image that was lost.

    `numbers` are the device's frame counters, `stamps_s` its time stamps, `play_at_s` when each frame is given.
    """
    numbers = list(numbers or range(len(depth)))
    stamps = list(stamps_s or [100.0 + n / FPS for n in numbers])
    images = list(color or [plain_color(n) for n in numbers]) if with_color else []
    device = rs.software_device()
    for key, value in (("name", "Intel RealSense D435I"), ("serial_number", SERIAL), ("usb_type_descriptor", usb)):
        device.register_info(getattr(rs.camera_info, key), value)
    stereo, rgb = device.add_sensor("Stereo Module"), device.add_sensor("RGB Camera")
    depth_profile = stereo.add_video_stream(
        _stream(rs.stream.depth, 1, _intrinsics(WIDTH, HEIGHT, F, CX, CY), rs.format.z16, 2)
    )
    stereo.add_read_only_option(rs.option.depth_units, depth_units)
    sensors = [(stereo, depth_profile)]
    if with_color:
        lens = _intrinsics(COLOR_WIDTH, COLOR_HEIGHT, COLOR_F, COLOR_CX, COLOR_CY)
        color_profile = rgb.add_video_stream(_stream(rs.stream.color, 2, lens, rs.format.rgb8, 3))
        between = rs.extrinsics()
        between.rotation = ROTATION_DEPTH_TO_COLOR.T.ravel().tolist()
        between.translation = OFFSET_DEPTH_TO_COLOR.tolist()
        depth_profile.register_extrinsics_to(color_profile, between)
        sensors.append((rgb, color_profile))
    recorder, sink = rs.recorder(str(path), device), rs.frame_queue(len(depth) * 2 + 2)
    for sensor, profile in sensors:
        sensor.open(profile)
        sensor.start(sink)
    for i, image in enumerate(depth):
        if image is not None:
            stereo.on_video_frame(_frame(depth_profile, image, 2, stamps[i] * 1e3, numbers[i]))
        if with_color and images[i] is not None:
            rgb.on_video_frame(_frame(color_profile, images[i], 3, stamps[i] * 1e3, numbers[i]))
        time.sleep(0.003)
    time.sleep(0.1)
    for sensor, _ in sensors:
        sensor.stop()
        sensor.close()
    del recorder
    play = list(play_at_s or [0.02 + n / FPS for n in range(len(depth))])
    streams = {"Depth": depth, "Color": images}
    retime(
        path,
        {
            name: [at for at, one in zip(play, every, strict=False) if one is not None]
            for name, every in streams.items()
        },
    )
    return path


def retime(path: Path, play_at_s: Mapping[str, Sequence[float]]) -> None:
    """Set when the images of each stream, in order, are given by the playback [s]."""
    with sqlite3.connect(path) as db:
        for topic, name in db.execute("SELECT id, name FROM topics").fetchall():
            if "/image/" not in name:
                continue
            times = play_at_s["Depth" if "Depth" in name else "Color"]
            rows = db.execute(
                "SELECT rowid FROM messages WHERE topic_id=? ORDER BY timestamp, rowid", [topic]
            ).fetchall()
            assert len(rows) == len(times), f"{len(rows)} of {len(times)} images were recorded in {name}"
            for (row,), at in zip(rows, times, strict=True):
                db.execute("UPDATE messages SET timestamp=? WHERE rowid=?", [int(at * 1e9), row])
