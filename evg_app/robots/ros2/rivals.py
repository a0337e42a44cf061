"""Is there exactly one robot behind our names? A second one on the same domain would take our goals, and move, too."""

from evg_app.errors import HardwareError
from evg_app.robots.ros2.link import Link

LEASE_S = 25.0
"""A server that died stays in sight of the others for about 20 s; so long is waited until one is left [s]."""


def servers(link: Link, action: str) -> int:
    """How many servers of this action are in sight."""
    return int(link.node.count_services(f"{action}/_action/send_goal"))


def require_one(link: Link, action: str, timeout: float = 0.0) -> None:
    """Pass when not more than one server of this action is in sight, waiting at most `timeout` [s] for it.

    Raises:
        HardwareError: there are more; whom a goal would move, nobody knows.
    """
    if not link.wait_until(lambda: servers(link, action) <= 1, timeout):
        raise HardwareError(too_many(servers(link, action), action))


def too_many(count: int, action: str) -> str:
    """What several servers of one name mean, and what to do."""
    return (
        f"{count} servers of {action} on this domain: a second robot, or a driver that died less than "
        f"{LEASE_S:.0f} s ago. Nothing was sent. Look: ros2 action info {action}; give each robot its own: "
        "export ROS_DOMAIN_ID=NUMBER"
    )
