"""Who is there of all that a robot config names."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from evg_app.clock import WallClock
from evg_app.config.models import RobotConfig
from evg_app.config.ros2 import Ros2Model
from evg_app.errors import BadInput
from evg_app.robots.ros2.interfaces import DEPENDENCIES, is_there
from evg_app.robots.ros2.link import Link
from evg_app.robots.ros2.network import network
from evg_app.robots.ros2.rivals import servers, too_many

LISTENED_S = 2.0
"""After the names, a second robot is listened for so long [s]: the network tells of one robot after the other."""


@dataclass(frozen=True)
class Survey:
    """What was seen.

    Attributes:
        lines: for a person.
        complete: everything that the config names is there.
    """

    lines: tuple[str, ...]
    complete: bool


def wanted(config: Ros2Model) -> dict[str, str]:
    """Every name of the config and what it is: "action", "service" or "topic"."""
    gripper, steps = config.gripper, config.recovery
    names = {config.arm_action: "action", config.joint_states: "topic", gripper.joint_states: "topic"}
    if gripper.kind == "franka":
        names |= dict.fromkeys((gripper.homing_action, gripper.move_action, gripper.grasp_action), "action")
        names[gripper.stop_service] = "service"
    else:
        names[gripper.command_action] = "action"
    names |= {name: "topic" for name in (config.robot_state, config.wrench) if name}
    if steps is not None:
        services = (steps.hardware_service, steps.switch_service)
        names |= {name: "service" for name in services if name}
        names |= {name: "action" for name in (steps.error_recovery_action,) if name}
    return names


def survey(robot: RobotConfig, seconds: float) -> Survey:
    """Look for at most `seconds` [s], and `LISTENED_S` longer for a second robot.

    Raises:
        BadInput: the robot has no `ros2` section.
        MissingExtra: rclpy is not installed.
    """
    if robot.ros2 is None:
        raise BadInput(f"robot '{robot.name}' has no 'ros2' section; see robot_configs/panda.yaml and docs/ros2.md")
    setting, names = network(), wanted(robot.ros2)
    lines = [f"network    {setting}"]
    lines += [f"FAULT      {fault}" for fault in setting.faults] + [f"note       {note}" for note in setting.notes]
    for package in DEPENDENCIES:
        there = is_there(package)
        lines.append(f"{'ok   ' if there else 'FAULT'}      {package}" + ("" if there else ": run evg-app ros build"))
    link = Link("evg_app_check", WallClock())
    link.acquire()
    try:
        link.wait_until(lambda: set(names) <= _seen(link) and bool(_nodes(link)), seconds)
        link.wait_until(lambda: bool(_doubled(link, names)), LISTENED_S)
        seen, nodes, doubled = _seen(link), _nodes(link), _doubled(link, names)
    finally:
        link.release()
    lines.append(f"nodes      {', '.join(nodes) or 'none: same ROS_DOMAIN_ID and discovery range on both sides?'}")
    lines += [f"{'ok   ' if name in seen else 'FAULT'}      {kind} {name}" for name, kind in names.items()]
    lines += [f"FAULT      {fault}" for fault in doubled]
    complete = set(names) <= seen and not (setting.faults or doubled) and all(map(is_there, DEPENDENCIES))
    if not complete:
        lines.append(f"start with: {robot.ros2.start_arm}\n            {robot.ros2.start_gripper}")
    return Survey(tuple(lines), complete)


def _doubled(link: Link, names: Mapping[str, str]) -> list[str]:
    """Actions that more than one robot serves, in words."""
    counts = {name: servers(link, name) for name, kind in names.items() if kind == "action"}
    return [too_many(count, name) for name, count in counts.items() if count > 1]


def _nodes(link: Link) -> list[str]:
    """Names of the other nodes; they turn up later than what they serve."""
    names: list[str] = link.call(link.node.get_node_names, "the names of nodes")
    return sorted(set(names) - {"evg_app_check"})


def _seen(link: Link) -> set[str]:
    """Names of everything that somebody else publishes or serves."""

    def ask() -> set[str]:
        """Look at the graph, on the executor's thread."""
        node: Any = link.node
        topics = {name for name, _ in node.get_topic_names_and_types() if node.count_publishers(name)}
        services = {name for name, _ in node.get_service_names_and_types()}
        return topics | services | {name.removesuffix("/_action/send_goal") for name in services}

    return link.call(ask, "the names on the network")
