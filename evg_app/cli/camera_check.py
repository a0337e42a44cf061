"""What `evg-app doctor --camera` and `evg-app camera preview` measure of an open camera."""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from evg_app.cameras.factory import open_camera, open_replay
from evg_app.cameras.protocol import Camera
from evg_app.cameras.realsense.camera import RealSenseCamera
from evg_app.cli.finding import Finding
from evg_app.cli.progress import say_warning
from evg_app.clock import Clock, WallClock
from evg_app.config.calibration import load_calibration
from evg_app.config.camera import CameraConfig
from evg_app.config.files import load_camera, load_robot
from evg_app.errors import BadInput, EvgError
from evg_app.geometry import Array, invert
from evg_app.perception.run_health import run_health
from evg_app.types import Frame

FRAMES = 10
"""Frames that a check looks at."""
MIN_VALID = 0.5
"""Share of the whole image with depth below which a check complains."""
MAX_FLICKER_M = 0.004
"""Change of a pixel's depth from frame to frame above which a check complains [m]."""
MIN_RATE = 0.7
"""Share of the configured frame rate below which a check complains."""


@dataclass(frozen=True)
class Measured:
    """A few frames of a still scene.

    Attributes:
        frame: the last one.
        rate: merged frames per second.
        valid: share of the image with depth in the last frame.
        flicker: median standard deviation of a pixel's depth over the frames [m].
    """

    frame: Frame
    rate: float
    valid: float
    flicker: float


def measure(camera: Camera, clock: Clock, timeout: float, frames: int = FRAMES) -> Measured:
    """Take some frames and look at them.

    Raises:
        DeviceTimeout, HardwareError: from the camera.
    """
    first = last = camera.capture(after=clock.now(), timeout=timeout)
    images = [first.metres()]
    for _ in range(frames - 1):
        last = camera.capture(after=last.stamp, timeout=timeout)
        images.append(last.metres())
    stack = np.stack(images)
    always = (stack > 0).all(axis=0)
    flicker = float(np.median(stack[:, always].std(axis=0))) if always.any() else 0.0
    passed = max(last.stamp - first.stamp, 1e-6)
    return Measured(last, (frames - 1) / passed, float((last.depth > 0).mean()), flicker)


def workspace_of(robot: str, camera: CameraConfig, config_dir: Path | None = None) -> Array:
    """T_cam_task (4, 4) of a camera that stands still, from its calibration.

    Raises:
        EvgError: there is no usable calibration, or the camera is on the hand.
    """
    config = load_robot(robot, config_dir)
    calibration = load_calibration(config, camera, config_dir)
    if calibration.mode == "eye-in-hand":
        raise BadInput("the camera is on the hand, so its pose needs the arm: evg-app run --dry-run checks it")
    return np.asarray(invert(calibration.T_base_cam(np.eye(4))) @ config.T_base_task.matrix())


def describe(camera: RealSenseCamera) -> Iterator[Finding]:
    """Device, link and settings."""
    info = camera.info
    if info.slow_link:
        yield Finding("camera link", "fault", f"USB {info.usb}", info.link_advice())
    else:
        yield Finding(
            "camera link", "ok", f"USB {info.usb or 'unknown'}, serial {info.serial}, firmware {info.firmware or '?'}"
        )
    if info.recommended and _number(info.firmware) < _number(info.recommended):
        mend = f"Update it to {info.recommended} with realsense-viewer or rs-fw-update"
        yield Finding("camera firmware", "note", f"{info.firmware} is older than recommended", mend)
    settings = ", ".join(f"{key} {value:g}" for key, value in camera.settings.items())
    yield Finding("camera settings", "ok", settings or "as recorded")


def _number(version: str) -> tuple[int, ...]:
    """A version as numbers that compare."""
    return tuple(int(part) for part in version.split(".") if part.isdigit())


def judge(seen: Measured) -> Iterator[Finding]:
    """Optics, how much depth there is, and how steady it is."""
    K, scale = seen.frame.intrinsics, seen.frame.depth_scale
    yield Finding(
        "camera optics",
        "ok",
        f"{K.width}x{K.height}, f {K.fx:.1f} {K.fy:.1f}, c {K.cx:.1f} {K.cy:.1f}, {scale:g} m per unit",
    )
    few = seen.valid < MIN_VALID
    mend = "Clean the lenses, switch the laser on, add light or texture, keep 0.3 to 1.5 m away" if few else ""
    yield Finding("camera depth", "note" if few else "ok", f"{seen.valid:.0%} of the image has depth", mend)
    rough = seen.flicker > MAX_FLICKER_M
    mend = "Bring the camera nearer, add light or texture, or raise realsense.average_frames" if rough else ""
    yield Finding("camera noise", "note" if rough else "ok", f"{seen.flicker * 1e3:.1f} mm from frame to frame", mend)


def judge_rate(seen: Measured, config: CameraConfig) -> Finding:
    """Whether the frames come as often as the config asks for."""
    wanted = config.realsense.fps / config.realsense.average_frames
    slow = seen.rate < MIN_RATE * wanted
    mend = "Frames get lost: another USB port or cable, no hub, fewer pixels or a lower realsense.fps" if slow else ""
    return Finding("camera rate", "note" if slow else "ok", f"{seen.rate:.1f} of {wanted:.1f} merged frames/s", mend)


def judge_table(frame: Frame, config: CameraConfig, workspace: Callable[[], Array]) -> Iterator[Finding]:
    """The workspace and the known table, when a calibration says where they are."""
    try:
        T_cam_task = workspace()
    except EvgError as error:
        yield Finding("camera table", "note", "not judged", str(error))
        return
    health = run_health(frame, T_cam_task, config)
    yield Finding("camera table", "ok" if health.ok else "fault", health.text(), health.advice)


def examine(args: argparse.Namespace) -> Iterator[Finding]:
    """Open the camera, take frames and judge them."""
    clock = WallClock()
    try:
        config = load_camera(args.camera, args.config_dir)
        if args.replay:
            with open_replay(config, args.replay, clock=clock, repeat=True) as replay:
                seen = measure(replay, clock, config.frame_timeout_s)
            yield Finding("camera source", "ok", f"stored frames of {args.replay}")
        else:
            with open_camera(config, clock=clock, sink=say_warning, serial=args.serial) as camera:
                yield from describe(camera)
                seen = measure(camera, clock, config.frame_timeout_s)
            yield judge_rate(seen, config)
    except EvgError as error:
        yield Finding(f"camera {args.camera}", "fault", str(error), "See docs/camera.md")
        return
    yield from judge(seen)
    yield from judge_table(seen.frame, config, partial(workspace_of, args.robot, config, args.config_dir))
