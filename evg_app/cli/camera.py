"""`evg-app camera`: list, look through, and record depth cameras.

Example: `evg-app camera preview --camera d435i --out preview.png`
"""

import argparse
import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from evg_app.cli.console import say
from evg_app.cli.progress import say_warning
from evg_app.config.files import load_camera, shipped_folder
from evg_app.errors import BadInput
from evg_app.types import Frame

RULES = "99-evg-app-realsense.rules"
PERIOD_S = 0.5
"""Time between two pictures of the preview [s]."""


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("camera", help="list, preview and record depth cameras", description=__doc__)
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    listing = actions.add_parser("list", help="cameras on USB: serial number, link, firmware")
    listing.set_defaults(run=run_list)
    rules = actions.add_parser("udev", help="how to give every user access to the camera")
    rules.set_defaults(run=run_udev)
    preview = actions.add_parser("preview", help="write what the camera sees to a picture, again and again")
    _common(preview)
    preview.add_argument("--replay", type=Path, metavar="PATH", help="a .db3 recording or a run folder instead")
    preview.add_argument("--out", type=Path, default=Path("preview.png"), metavar="FILE", help="default: preview.png")
    preview.add_argument("--robot", metavar="NAME", help="with its calibration: also judge the table")
    preview.set_defaults(run=run_preview)
    record = actions.add_parser("record", help="write the camera's streams to a .db3 file")
    record.add_argument("file", type=Path, metavar="FILE.db3")
    _common(record)
    record.set_defaults(run=run_record)


def _common(parser: argparse.ArgumentParser) -> None:
    """Options that several verbs share."""
    parser.add_argument("--camera", default="d435i", metavar="NAME", help="robot_configs/NAME.yaml (default: d435i)")
    parser.add_argument("--serial", default="", metavar="S", help="which of several cameras")
    parser.add_argument("--seconds", type=_seconds, default=10.0, metavar="T", help="how long (default: 10)")
    parser.add_argument("--config-dir", type=Path, metavar="DIR", help="your own robot_configs/")


def _seconds(text: str) -> float:
    """A time from the command line [s]."""
    value = float(text)
    if not 0.1 <= value <= 86400:
        raise argparse.ArgumentTypeError("must be between 0.1 and 86400 seconds")
    return value


def run_list(args: argparse.Namespace) -> int:
    """Print every camera. Returns 0.

    Raises:
        HardwareError: there is none; says why it may be.
    """
    from evg_app.cameras.realsense.devices import list_cameras, require_any
    from evg_app.cameras.realsense.sdk import load_sdk

    rs = load_sdk()
    found = require_any(list_cameras(rs))
    say(f"{'serial':<14} {'USB':<5} {'firmware':<14} name")
    for info in found:
        say(f"{info.serial:<14} {info.usb or '?':<5} {info.firmware or '?':<14} {info.name}")
        if info.link_advice():
            say(f"  -> {info.link_advice()}")
    return 0


def run_udev(args: argparse.Namespace) -> int:
    """Say how the udev rules are installed. Returns 0."""
    rules = shipped_folder() / "robot_configs" / RULES
    say(f"sudo cp '{rules}' /etc/udev/rules.d/")
    say("sudo udevadm control --reload-rules && sudo udevadm trigger")
    say("# then unplug the camera, plug it in again, and run: evg-app camera list")
    return 0


def run_record(args: argparse.Namespace) -> int:
    """Record. Returns 0.

    Raises:
        EvgError: bad file name, or from the camera.
    """
    from evg_app.cameras.factory import open_camera
    from evg_app.clock import WallClock

    target, clock = args.file, WallClock()
    if target.suffix != ".db3" or target.exists() or not target.resolve().parent.is_dir():
        raise BadInput(f"{target} must be a new file that ends in .db3, in a folder that exists. Name another one")
    config = load_camera(args.camera, args.config_dir)
    with open_camera(config, clock=clock, sink=say_warning, serial=args.serial, record_to=target) as camera:
        say(f"recording {camera.info.name or args.camera} {camera.info.serial} for {args.seconds:g} s; Ctrl-C ends it")
        end, count = clock.now() + args.seconds, 0
        try:
            while clock.now() < end:
                camera.capture(after=clock.now(), timeout=config.frame_timeout_s)
                count += 1
        except KeyboardInterrupt:
            say("stopped")
    size = target.stat().st_size / 1e6
    say(f"{target}: {size:.1f} MB, {count} merged frames seen. Look at it: evg-app camera preview --replay {target}")
    return 0


def run_preview(args: argparse.Namespace) -> int:
    """Look through the camera. Returns 0.

    Raises:
        EvgError: from the camera or the calibration.
    """
    from evg_app.cameras.factory import open_camera, open_replay
    from evg_app.cli.camera_check import workspace_of
    from evg_app.clock import WallClock
    from evg_app.perception.run_health import run_health

    config, clock = load_camera(args.camera, args.config_dir), WallClock()
    T_cam_task = workspace_of(args.robot, config, args.config_dir) if args.robot else None
    camera = (
        open_replay(config, args.replay, clock=clock, repeat=True)
        if args.replay
        else open_camera(config, clock=clock, sink=say_warning, serial=args.serial)
    )
    with camera:
        say(f"writing {args.out} every {PERIOD_S:g} s for {args.seconds:g} s; Ctrl-C ends it")
        end = clock.now() + args.seconds
        try:
            while clock.now() < end:
                frame = camera.capture(after=clock.now(), timeout=config.frame_timeout_s)
                health = "" if T_cam_task is None else f"; {run_health(frame, T_cam_task, config).text()}"
                _write(args.out, frame)
                say(f"{(frame.depth > 0).mean():.0%} with depth, {_middle(frame)}{health}")
                clock.sleep(PERIOD_S)
        except KeyboardInterrupt:
            say("stopped")
    return 0


def _middle(frame: Frame) -> str:
    """Distance in the middle of the image."""
    h, w = frame.depth.shape
    middle = frame.metres()[h // 2 - 10 : h // 2 + 10, w // 2 - 10 : w // 2 + 10]
    seen = middle[middle > 0]
    return f"{np.median(seen):.3f} m in the middle" if seen.size else "no depth in the middle"


def picture(frame: Frame) -> NDArray[np.uint8]:
    """Colour (when there is any) beside depth. RGB, shape (H, W or 2 W, 3)."""
    from evg_app.trials.pictures import depth_as_color

    depth = depth_as_color(frame)
    return depth if frame.color is None else np.concatenate([frame.color, depth], axis=1)


def _write(path: Path, frame: Frame) -> None:
    """Write a picture whole or not at all."""
    from evg_app.trials.arrays import write_atomically

    buffer = io.BytesIO()
    Image.fromarray(picture(frame)).save(buffer, format="PNG", compress_level=1)
    try:
        write_atomically(path, buffer.getvalue())
    except OSError as error:
        raise BadInput(f"--out {path} cannot be written: {error.strerror}. Name another file") from error
