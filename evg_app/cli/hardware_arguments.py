"""What `evg-app run` takes for real hardware only, and what it looks up before anything is loaded."""

import argparse
from pathlib import Path

from evg_app.config.calibration import Calibration, load_calibration
from evg_app.config.files import load_camera
from evg_app.config.models import CameraConfig, RobotConfig
from evg_app.errors import BadInput, Refused

REPLAY = "replay/"
"""A camera of this name hands out stored frames: `replay/FILE.db3` or `replay/RUN_FOLDER`."""
REPLAYED_CAMERA = "d435i"
"""Whose config and calibration stored frames are taken for."""


def _share(text: str) -> float:
    """A share of the speed from the command line."""
    value = float(text)
    if not 0 < value <= 1:
        raise argparse.ArgumentTypeError("must be above 0 and at most 1 (share of the configured speed)")
    return value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what only a real run takes."""
    group = parser.add_argument_group("hardware (software limits, NOT a safety function)")
    group.add_argument("--driver", choices=("ros2", "fci"), help="how to reach the arm (default: the robot's config)")
    group.add_argument("--host", default="", metavar="ADDRESS", help="the arm's address for --driver fci")
    group.add_argument("--serial", default="", metavar="S", help="which of several cameras")
    group.add_argument(
        "--confirm-speed",
        type=_share,
        metavar="X",
        help="drive at X of the configured speed from now on; a new robot starts at 0.1",
    )
    group.add_argument("--step", action="store_true", help="ask before each motion")
    group.add_argument("--dry-run", action="store_true", help="everything but motion: look, plan, judge, log")
    group.add_argument(
        "--stop-file", type=Path, metavar="FILE", help="creating it stops the motion now (default: RUN_DIR/STOP)"
    )


def refuse_with_sim(args: argparse.Namespace) -> None:
    """Pass when no hardware option stands beside --sim.

    Raises:
        BadInput: which one does.
    """
    given = {
        "--driver": args.driver,
        "--host": args.host,
        "--serial": args.serial,
        "--confirm-speed": args.confirm_speed,
        "--step": args.step,
        "--dry-run": args.dry_run,
        "--stop-file": args.stop_file,
    }
    wrong = [name for name, value in given.items() if value]
    if wrong:
        raise BadInput(f"{', '.join(wrong)}: for real hardware only. Leave out --sim, or these")


def camera_config_of(name: str, config_dir: Path | None) -> CameraConfig:
    """The config of a camera, or of stored frames.

    Raises:
        UnknownName: there is none of that name.
    """
    return load_camera(REPLAYED_CAMERA if name.startswith(REPLAY) else name, config_dir)


def require_ready(robot: RobotConfig, camera: CameraConfig, config_dir: Path | None) -> Calibration:
    """The calibration of these devices, when a run may use it and the robot has a tool box.

    Raises:
        Refused: with the command to run.
    """
    if robot.tool_box is None:
        raise Refused(
            f"robot '{robot.name}' has no tool_box: say where its tool may go. "
            "See robot_configs/panda.yaml and docs/bringup.md"
        )
    return load_calibration(robot, camera, config_dir)
