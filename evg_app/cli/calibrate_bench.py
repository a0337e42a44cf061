"""The bench of `evg-app calibrate`: the stand-in's, or the real arm and camera; and samples taken by hand."""

import argparse
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from evg_app.cli.console import hushed, say
from evg_app.config.calibration import Mode
from evg_app.config.files import load_camera, load_robot
from evg_app.config.speed import confirmed_speed

if TYPE_CHECKING:
    from evg_app.handeye.collect import Bench, OnSample
    from evg_app.handeye.sample import Session
    from evg_app.handeye.standin.bench import SimulatedBench

SLICE = 0.1
"""Time between two looks while nobody presses a key [s]."""
MANUAL = """Guide the arm by hand to 15 or more poses that show the board: tilt it about x, y and z by 15 to 30 degrees,
near and far, in every corner of the picture. Let go, then press Enter to take a sample; q and Enter ends.
With --view the browser shows what is detected, and where corners were so far."""


def simulated(args: argparse.Namespace, mode: Mode, on_sample: "OnSample") -> "SimulatedBench":
    """The stand-in of a seed."""
    with hushed():
        from evg_app.handeye.boards import load_board
        from evg_app.handeye.standin.bench import simulated_bench
        from evg_app.motion.feasibility import MotionPlanner
    robot, camera = load_robot(args.robot, args.config_dir), load_camera(args.camera, args.config_dir)
    board = load_board(args.board, args.config_dir)
    return simulated_bench(MotionPlanner(robot), robot, camera, board, mode, args.seed, on_sample)


@contextmanager
def real(args: argparse.Namespace, mode: Mode, on_sample: "OnSample") -> "Iterator[Bench]":
    """The real arm and camera, entered, at the speed that a person confirmed for this robot.

    Raises:
        EvgError: a bad name or file, or a device failed.
    """
    with hushed():
        from evg_app.cameras.factory import open_camera
        from evg_app.cli.operator import Operator
        from evg_app.cli.real_lab import Wishes, guarded_arm
        from evg_app.clock import WallClock
        from evg_app.handeye.boards import load_board
        from evg_app.handeye.collect import Bench
        from evg_app.handeye.color import ColorPictures
        from evg_app.motion.feasibility import MotionPlanner
        from evg_app.picking.stop import StopToken
    robot, config = load_robot(args.robot, args.config_dir), load_camera(args.camera, args.config_dir)
    board, motion = load_board(args.board, args.config_dir), MotionPlanner(robot)
    wishes = Wishes(args.driver or robot.driver, args.camera, args.host, args.serial)
    arm, clock = guarded_arm(robot, wishes, motion.kinematics, Operator(StopToken()).confirm, WallClock())
    camera = open_camera(config, clock=clock, serial=args.serial)
    pictures = ColorPictures(camera)
    with pictures, arm:
        share = confirmed_speed(robot.name, args.config_dir)
        say(f"speed {share:g} of the configured limits; keep your hand at the emergency stop")
        yield Bench(arm, pictures, clock, motion, robot, config, board, mode, on_sample, share, camera.T_color_depth)


def by_hand(bench: "Bench", preview: "OnSample") -> "Session":
    """Take a sample at each Enter until q, or the end of input; `preview` is shown what the camera sees in between."""
    with hushed():
        from evg_app.handeye.by_hand import collect_by_hand
    say(MANUAL)
    return collect_by_hand(bench, _key, preview)


def _key() -> str | None:
    """A line of standard input; None when none came within `SLICE`, q at its end."""
    if not select.select([sys.stdin], [], [], SLICE)[0]:
        return None
    return sys.stdin.readline() or "q"
