"""The memory that the streaming process and the application share: one state, and two orders. No locks."""

import time
from dataclasses import dataclass
from multiprocessing.sharedctypes import RawArray
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from evg_app.geometry import Array

JOINTS = 7
_FIELDS = {
    "stamp": 1,
    "mode": 1,
    "moving": 1,
    "errors": 1,
    "q": JOINTS,
    "dq": JOINTS,
    "q_d": JOINTS,
    "wrench": 6,
    "success_rate": 1,
    "received": 1,
    "lost": 1,
    "longest": 1,
}
_OFFSETS: dict[str, slice] = {}
_size = 1
for _name, _count in _FIELDS.items():
    _OFFSETS[_name] = slice(_size, _size + _count)
    _size += _count
SIZE = _size


@dataclass(frozen=True)
class Snapshot:
    """One state as the streaming process saw it.

    Attributes:
        stamp: when it arrived, monotonic clock [s].
        mode: libfranka's robot mode (0 other, 1 idle, 2 move, 3 guiding, 4 reflex, 5 user stopped, 6 recovery).
        moving: a motion of ours is being streamed.
        errors: bit k is set when error k is active.
        q, dq, q_d: measured position, velocity and set point. Shape (7,) [rad].
        wrench: external force [N] and torque [Nm] in the base frame. Shape (6,).
        success_rate: share of the last 100 commands that the controller received, 0 without a motion.
        received, lost: states since connecting.
        longest: most states lost in a row.
    """

    stamp: float
    mode: int
    moving: bool
    errors: int
    q: Array
    dq: Array
    q_d: Array
    wrench: Array
    success_rate: float
    received: int
    lost: int
    longest: int


class StateBlock:
    """The latest state; one process writes, any number read. A torn read is noticed and repeated."""

    def __init__(self) -> None:
        self.raw = RawArray("d", SIZE)

    def view(self) -> Array:
        """The memory as an array; element 0 counts writes and is odd while one is under way."""
        return np.frombuffer(self.raw, dtype=np.float64)

    def read(self) -> Snapshot | None:
        """The latest state, None before the first."""
        view = self.view()
        while True:
            before = view[0]
            row = view.copy()
            if before % 2 == 0 and view[0] == before:
                break
            time.sleep(0)
        if before == 0:
            return None
        value: dict[str, Any] = {name: row[where] for name, where in _OFFSETS.items()}
        return Snapshot(
            stamp=float(value["stamp"][0]),
            mode=int(value["mode"][0]),
            moving=bool(value["moving"][0]),
            errors=int(value["errors"][0]),
            q=value["q"],
            dq=value["dq"],
            q_d=value["q_d"],
            wrench=value["wrench"],
            success_rate=float(value["success_rate"][0]),
            received=int(value["received"][0]),
            lost=int(value["lost"][0]),
            longest=int(value["longest"][0]),
        )


class StateWriter:
    """The writing side of a `StateBlock`."""

    def __init__(self, block: StateBlock) -> None:
        self._view = block.view()
        self._row = np.zeros(SIZE)

    def write(self, **fields: ArrayLike) -> None:
        """Change the given fields and publish everything."""
        for name, value in fields.items():
            self._row[_OFFSETS[name]] = value
        view = self._view
        view[0] += 1
        view[1:] = self._row[1:]
        view[0] += 1


class Orders:
    """What the application tells a motion under way: stop, and "I am still looking"."""

    def __init__(self) -> None:
        self.raw = RawArray("d", 2)

    def cancel(self, motion: int) -> None:
        """Stop the motion of this number."""
        self.raw[0] = motion

    def cancelled(self, motion: int) -> bool:
        """Whether it was told to stop."""
        return bool(self.raw[0] >= motion)

    def look(self) -> None:
        """The application is alive and watches."""
        self.raw[1] = time.monotonic()

    def looked(self) -> float:
        """When it last did, monotonic clock [s]."""
        return float(self.raw[1])
