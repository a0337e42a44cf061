"""`evg-app workspace --marker BOARD`: the table from pictures of a printed board that lies on it."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from evg_app.cli.console import say
from evg_app.config.calibration import load_calibration
from evg_app.config.files import load_camera
from evg_app.config.models import RobotConfig
from evg_app.errors import Stopped
from evg_app.geometry import Array
from evg_app.perception.touched import TouchedTable

if TYPE_CHECKING:
    from evg_app.cameras.protocol import Camera
    from evg_app.config.calibration import Calibration
    from evg_app.handeye.boards import Board

PICTURES = 10
"""Pictures of a camera that stands still."""
POSES = 5
"""Places from which a camera on the hand looks."""
FRAME_S = 5.0
"""A picture may take this long [s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what only the marker takes."""
    group = parser.add_argument_group("with a calibrated camera instead of touching")
    group.add_argument("--marker", metavar="BOARD", help="a board of calibration/boards/ that lies on the table")
    group.add_argument("--plate-mm", type=float, default=0.0, metavar="MM", help="thickness of what it is glued onto")
    group.add_argument("--camera", default="d435i", metavar="NAME", help="robot_configs/NAME.yaml (default: d435i)")
    group.add_argument("--serial", default="", metavar="S", help="which of several cameras")


def by_marker(args: argparse.Namespace, robot: RobotConfig, ready: Callable[[str], bool]) -> TouchedTable:
    """Look at the board, and say where the table is. A camera that stands still needs no arm.

    Raises:
        Refused: no calibration that may be used, or pictures that make no table.
        Stopped: the input ended.
        EvgError: a bad name, or a device failed.
    """
    from evg_app.cameras.factory import open_camera
    from evg_app.clock import WallClock
    from evg_app.handeye.boards import load_board
    from evg_app.handeye.color import ColorPictures

    config = load_camera(args.camera, args.config_dir)
    calibration, board = load_calibration(robot, config, args.config_dir), load_board(args.marker, args.config_dir)
    _ask(ready, f"Lay the board '{args.marker}' flat on the table, its middle where the square's is, then press Enter")
    pictures = ColorPictures(open_camera(config, clock=WallClock(), serial=args.serial))
    with pictures as camera, _hand(args, robot, calibration) as T_base_hand:
        return look(camera, board, calibration, T_base_hand, ready, 1e-3 * args.plate_mm)


def look(
    camera: "Camera",
    board: "Board",
    calibration: "Calibration",
    T_base_hand: Callable[[], Array],
    ready: Callable[[str], bool],
    plate: float,
) -> TouchedTable:
    """Take the pictures and judge them; `plate` is the thickness below the print [m].

    Raises:
        Refused, Stopped, HardwareError: as `by_marker`.
    """
    from evg_app.handeye.collect import gray_of
    from evg_app.handeye.detect import detect
    from evg_app.handeye.marked import corners_on_table, marked_table, picture_pose

    by_hand = calibration.mode == "eye-in-hand"
    scale = calibration.board_scale if calibration.board == board.model.name else 1.0
    found, count, stamp = [], POSES if by_hand else PICTURES, 0.0
    for number in range(1, count + 1):
        if by_hand:
            _ask(ready, f"Guide the arm to place {number} of {count} with the whole board in view, then press Enter")
        frame = camera.capture(after=stamp, timeout=FRAME_S)
        stamp = frame.stamp
        seen = detect(board, gray_of(frame), frame.intrinsics)
        say(f"  picture {number}: {len(seen.ids)} corners, {seen.problem or 'ok'}")
        if seen.ok:
            found.append(corners_on_table(board, seen, picture_pose(calibration, T_base_hand()), scale, plate))
    return marked_table(found, count)


@contextmanager
def _hand(args: argparse.Namespace, robot: RobotConfig, calibration: "Calibration") -> Iterator[Callable[[], Array]]:
    """How to learn where the hand is (4, 4); for a camera that stands still nobody is asked."""
    if calibration.mode == "eye-to-hand":
        yield lambda: np.eye(4)
        return
    from evg_app.cli.real_lab import Wishes, open_arm
    from evg_app.motion.kinematics import Kinematics

    kinematics = Kinematics(robot)
    with open_arm(robot, Wishes(args.driver or robot.driver, "", args.host), kinematics) as arm:
        yield lambda: np.asarray(kinematics.fk_hand(arm.state().q))


def _ask(ready: Callable[[str], bool], what: str) -> None:
    """Wait for a person, who may end here."""
    if not ready(what):
        raise Stopped("stopped before the board was looked at; nothing was changed")
