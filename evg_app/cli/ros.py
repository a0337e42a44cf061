"""`evg-app ros`: make the missing ROS interface packages, and look whether the robot can be seen.

Example: `evg-app ros build && evg-app ros check --robot panda`
"""

import argparse
from pathlib import Path

from evg_app.cli.console import say


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("ros", help="ROS 2: build interface packages, look at the network", description=__doc__)
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    make = actions.add_parser("build", help="build control_msgs, controller_manager_msgs and franka_msgs (1-2 minutes)")
    make.add_argument("--force", action="store_true", help="build again what is built")
    make.set_defaults(run=_build)
    check = actions.add_parser("check", help="show middleware, domain and range, and who answers of what is configured")
    check.add_argument("--robot", default="panda", metavar="NAME", help="robot_configs/NAME.yaml (default: panda)")
    check.add_argument("--config-dir", type=Path, metavar="DIR", help="your own robot_configs/, looked up first")
    check.add_argument("--seconds", type=float, default=5.0, metavar="S", help="how long to look (default: 5)")
    check.set_defaults(run=_check)


def _build(args: argparse.Namespace) -> int:
    """Build the interface packages."""
    from evg_app.robots.ros2.build import build

    build(say, args.force)
    return 0


def _check(args: argparse.Namespace) -> int:
    """Say what is seen. Returns 0 when everything that the robot config names is there, else 4."""
    from evg_app.config.files import load_robot
    from evg_app.robots.ros2.survey import survey

    found = survey(load_robot(args.robot, args.config_dir), args.seconds)
    for line in found.lines:
        say(line)
    return 0 if found.complete else 4
