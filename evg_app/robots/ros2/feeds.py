"""What the robot publishes, kept as the latest message with an honest age."""

import struct
from collections.abc import Sequence
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


class Feed:
    """The latest message of one topic, kept as bytes: robots publish at 1 kHz, but only what is read is decoded.

    Args:
        marks: strings that a message must contain to count; a merged /joint_states carries other joints, too.
    """

    def __init__(self, clock: Clock, topic: str, timeout: float, advice: str, marks: Sequence[str] = ()) -> None:
        self._clock, self.topic, self._timeout, self._advice = clock, topic, timeout, advice
        self._marks = tuple(mark.encode() + b"\0" for mark in marks)
        self._offset = ClockOffset()
        self._latest: tuple[bytes, float] | None = None
        self._decoded: tuple[bytes, Any] | None = None
        self._kind: Any = None
        self._subscription: Any = None

    def subscribe(self, link: Link, kind: Any) -> None:
        """Listen; compatible with reliable and best-effort publishers alike."""
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.forget()
        self._kind = kind
        self._subscription = link.call(
            lambda: link.node.create_subscription(kind, self.topic, self._hear, quality, raw=True),
            f"listening to {self.topic}",
        )

    def unsubscribe(self, link: Link) -> None:
        """Stop listening."""
        subscription, self._subscription = self._subscription, None
        if subscription is not None and link.alive:
            link.call(lambda: link.node.destroy_subscription(subscription), f"leaving {self.topic}")

    def forget(self) -> None:
        """Start anew: what was heard so far does not count."""
        self._latest, self._decoded, self._offset = None, None, ClockOffset()

    def _hear(self, message: bytes) -> None:
        """Keep a message that carries what is looked for."""
        if all(mark in message for mark in self._marks):
            self._latest = message, self._offset.local(header_stamp(message), self._clock.now())

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
            told = "never heard" if latest is None else f"last one {self.age:.2f} s old"
            raise DeviceTimeout(f"{self.topic} ({told})", self._timeout, self._advice)
        return self._decode(latest[0]), latest[1]

    def _decode(self, message: bytes) -> Any:
        """The message as an object; decoded once."""
        decoded = self._decoded
        if decoded is None or decoded[0] is not message:
            from rclpy.serialization import deserialize_message

            self._decoded = decoded = message, deserialize_message(message, self._kind)
        return decoded[1]


def header_stamp(message: bytes) -> float:
    """The stamp [s] of a serialized message that starts with a std_msgs/Header (CDR: 4 bytes, then int32, uint32)."""
    sec, nanosec = struct.unpack_from("<iI" if message[1] & 1 else ">iI", message, 4)
    return float(sec) + 1e-9 * float(nanosec)


class Joints:
    """Picks named joints out of JointState messages."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)

    def read(self, message: Any) -> tuple[Array, Array]:
        """Positions and velocities in our order; velocity 0 where the message has none. Shapes (J,), (J,)."""
        index = [list(message.name).index(name) for name in self._names]
        q = np.asarray(message.position, dtype=np.float64)[index]
        full = len(message.velocity) == len(message.name)
        return q, np.asarray(message.velocity, dtype=np.float64)[index] if full else np.zeros(len(index))
