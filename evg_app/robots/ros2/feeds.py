"""What the robot publishes, kept as the latest message with an honest age."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from evg_app.clock import Clock
from evg_app.errors import DeviceTimeout
from evg_app.geometry import Array
from evg_app.robots.ros2.link import Link

OFFSET_WINDOW = 30.0
"""How long the smallest distance between two clocks is remembered [s]: longer than any hiccup, shorter than drift."""


class ClockOffset:
    """Brings stamps of another machine to our clock, without that the clocks agree.

    The message that travelled fastest in the last `OFFSET_WINDOW` defines the offset; one that is late by comparison
    is old by as much.
    """

    def __init__(self) -> None:
        self._now = self._before = float("inf")
        self._began = 0.0

    def local(self, stamp: float, arrived: float) -> float:
        """When the message was made, on our clock [s]. A zero stamp counts as made on arrival."""
        if stamp <= 0.0:
            return arrived
        if arrived - self._began > OFFSET_WINDOW:
            self._began, self._before, self._now = arrived, self._now, float("inf")
        self._now = min(self._now, arrived - stamp)
        return stamp + min(self._now, self._before)


def seconds(stamp: Any) -> float:
    """A builtin_interfaces/Time or Duration [s]."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


class Feed:
    """The latest message of one topic.

    Args:
        wanted: which messages count; a merged /joint_states carries other joints, too.
    """

    def __init__(
        self, clock: Clock, topic: str, timeout: float, advice: str, wanted: Callable[[Any], bool] = lambda _: True
    ) -> None:
        self._clock, self.topic, self._timeout, self._advice, self._wanted = clock, topic, timeout, advice, wanted
        self._offset = ClockOffset()
        self._latest: tuple[Any, float] | None = None
        self._subscription: Any = None

    def subscribe(self, link: Link, kind: Any) -> None:
        """Listen; compatible with reliable and best-effort publishers alike."""
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.forget()
        self._subscription = link.call(
            lambda: link.node.create_subscription(kind, self.topic, self._hear, quality), f"listening to {self.topic}"
        )

    def unsubscribe(self, link: Link) -> None:
        """Stop listening."""
        subscription, self._subscription = self._subscription, None
        if subscription is not None and link.alive:
            link.call(lambda: link.node.destroy_subscription(subscription), f"leaving {self.topic}")

    def forget(self) -> None:
        """Start anew: what was heard so far does not count."""
        self._latest, self._offset = None, ClockOffset()

    def _hear(self, message: Any) -> None:
        if self._wanted(message):
            arrived = self._clock.now()
            self._latest = message, self._offset.local(seconds(message.header.stamp), arrived)

    @property
    def age(self) -> float:
        """How old the latest message is [s]; infinite without one."""
        latest = self._latest
        return float("inf") if latest is None else self._clock.now() - latest[1]

    @property
    def fresh(self) -> bool:
        """Whether the latest message is young enough."""
        return self.age <= self._timeout

    def latest(self) -> tuple[Any, float]:
        """The latest message and when it was made [s].

        Raises:
            DeviceTimeout: it is too old, or there is none.
        """
        latest = self._latest
        if latest is None or not self.fresh:
            told = "never heard" if latest is None else f"last heard {self.age:.2f} s ago"
            raise DeviceTimeout(f"{self.topic} ({told})", self._timeout, self._advice)
        return latest


class Joints:
    """Picks named joints out of JointState messages."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)

    def carried_by(self, message: Any) -> bool:
        """Whether the message has all of them."""
        return set(self._names) <= set(message.name) and len(message.position) == len(message.name)

    def read(self, message: Any) -> tuple[Array, Array]:
        """Positions and velocities in our order; velocity 0 where the message has none. Shapes (J,), (J,)."""
        index = [list(message.name).index(name) for name in self._names]
        q = np.asarray(message.position, dtype=np.float64)[index]
        full = len(message.velocity) == len(message.name)
        return q, np.asarray(message.velocity, dtype=np.float64)[index] if full else np.zeros(len(index))
