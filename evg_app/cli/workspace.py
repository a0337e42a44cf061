"""`evg-app workspace`: measure T_base_task by touching the table with the finger tips, or by a board that lies on it.

Examples: `evg-app workspace --robot fr3 --driver fci --host 172.16.0.2 --config-dir my`
`evg-app workspace --robot fr3 --marker charuco_a4 --camera d435i --config-dir my --write`
"""

import argparse
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from evg_app.cli import workspace_marker
from evg_app.cli.console import say
from evg_app.config.files import find, load_robot, shipped_folder
from evg_app.config.models import RobotConfig
from evg_app.errors import BadInput, Stopped
from evg_app.geometry import FINGER_DEPTH, Array, translation
from evg_app.perception.touched import TouchedTable, touched_table

CORNERS = ("near right", "near left", "far left", "far right")
"""Of the square, as seen from the robot's base."""


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("workspace", help="measure where the table is", description=__doc__)
    parser.add_argument("--robot", default="panda", metavar="NAME", help="robot_configs/NAME.yaml (default: panda)")
    parser.add_argument("--driver", choices=("ros2", "fci"), help="how to reach the arm (default: the robot's config)")
    parser.add_argument("--host", default="", metavar="ADDRESS", help="the arm's address for --driver fci")
    parser.add_argument("--config-dir", type=Path, metavar="DIR", help="your own robot_configs/, looked up first")
    parser.add_argument("--write", action="store_true", help="put the result into your robot_configs/NAME.yaml")
    workspace_marker.add_arguments(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Find the table by touches or by a board, and say where the workspace is. Returns 0.

    Raises:
        EvgError: refusal, hardware, or the person stopped.
    """
    robot = load_robot(args.robot, args.config_dir)
    target = own_file(args.robot, args.config_dir) if args.write else None
    from evg_app.cli.operator import Operator
    from evg_app.picking.stop import StopToken

    operator = Operator(StopToken())
    if args.marker:
        table = workspace_marker.by_marker(args, robot, operator.ready)
    else:
        table = _by_touch(args, robot, operator.ready)
    report(robot, table)
    if target is not None:
        write(target, table)
        say(f"written to {target}")
    return 0


def _by_touch(args: argparse.Namespace, robot: RobotConfig, ready: Callable[[str], bool]) -> TouchedTable:
    """With the arm guided by hand."""
    from evg_app.cli.real_lab import Wishes, open_arm
    from evg_app.motion.kinematics import Kinematics, hand_to_grasp

    kinematics = Kinematics(robot)
    to_tip = hand_to_grasp(robot) @ translation(0.0, 0.0, FINGER_DEPTH)
    with open_arm(robot, Wishes(args.driver or robot.driver, "", args.host), kinematics) as arm:
        return measure(lambda: (kinematics.fk_hand(arm.state().q) @ to_tip)[:3, 3], ready)


def measure(tip: Callable[[], Array], ready: Callable[[str], bool]) -> TouchedTable:
    """Ask for the four corners and read `tip` (3,) [m] at each.

    Raises:
        Stopped: the input ended.
        Refused: the touches make no table.
    """
    say("Close the fingers and guide the arm by hand. Nothing is moved by evg-app.")
    points = []
    for corner in CORNERS:
        if not ready(f"Put the finger tips on the {corner} corner of the square, then press Enter"):
            raise Stopped("stopped before all corners were touched; nothing was changed")
        points.append(tip())
        say("  tip at " + ", ".join(f"{v:.4f}" for v in points[-1]) + " m")
    return touched_table(np.array(points))


def report(robot: RobotConfig, table: TouchedTable) -> None:
    """Say what was found, and how far the config was off."""
    off = table.origin - np.array(robot.T_base_task.xyz_m)
    say(f"table top {table.height * 1e3:.1f} mm, tilt {table.tilt_deg:.2f} deg, fit {table.residual * 1e3:.1f} mm")
    say(f"the config was off by {', '.join(f'{v * 1e3:+.1f}' for v in off)} mm")
    say(f"T_base_task:\n  xyz_m: {_numbers(table)}")


def own_file(name: str, config_dir: Path | None) -> Path:
    """The robot's file, if it is the user's own.

    Raises:
        BadInput: it is the shipped one.
    """
    path = find("robot", "robot_configs", name, config_dir)
    if shipped_folder() in path.parents and config_dir is None:
        raise BadInput(
            f"{path} is the shipped config. Run: mkdir -p my/robot_configs && cp {path} my/robot_configs/ "
            f"and give --config-dir my"
        )
    return path


def write(path: Path, table: TouchedTable) -> None:
    """Replace the numbers of T_base_task, and nothing else.

    Raises:
        BadInput: the file has no plain `T_base_task:` with `xyz_m: [...]`.
    """
    text = path.read_text(encoding="utf-8")
    place = re.compile(r"(^T_base_task:\n(?:\s+#.*\n)*\s+xyz_m: )\[[^\]]*\]", re.MULTILINE)
    changed, count = place.subn(rf"\g<1>{_numbers(table)}", text)
    if count != 1:
        raise BadInput(f"{path} has no 'T_base_task:' with 'xyz_m: [...]' below it. Put the numbers there by hand")
    path.write_text(changed, encoding="utf-8")


def _numbers(table: TouchedTable) -> str:
    """The origin as YAML."""
    return "[" + ", ".join(f"{v:.4f}" for v in table.origin) + "]"
