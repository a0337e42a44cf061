"""What arm and gripper over ROS 2 share: who must be there before they are used, and a way out that always works."""

import contextlib
from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from evg_app.config.ros2 import Ros2Model
from evg_app.errors import HardwareError
from evg_app.robots.ros2.link import Link
from evg_app.robots.ros2.rivals import LEASE_S, require_one


class Ros2Device(ABC):
    """A device on the node that it shares with others.

    Args:
        link: the node.
    """

    def __init__(self, config: Ros2Model, link: Link) -> None:
        self._config, self._link = config, link
        self._entered = False

    def __enter__(self) -> Self:
        """Connect, and wait until everything that the config names is there, once.

        Raises:
            MissingExtra: rclpy is not installed.
            HardwareError: somebody did not turn up, or two did; named, with the command to run.
        """
        self._link.acquire()
        self._entered = True
        try:
            self._open()
            self._link.wait_until(lambda: not self._missing(), self._config.server_timeout_s)
            missing = self._missing()
            if missing:
                raise HardwareError(self._not_found(missing))
            for action in self._served():
                require_one(self._link, action, LEASE_S)
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop what is under way and disconnect; never raises, may be called twice."""
        if not self._entered:
            return
        self._entered = False
        for step in (self._halt, self._close):
            with contextlib.suppress(HardwareError):
                step()
        self._link.release()

    @abstractmethod
    def _open(self) -> None:
        """Subscribe, and make the clients."""

    @abstractmethod
    def _missing(self) -> list[str]:
        """Names on the wire of whoever is not there."""

    @abstractmethod
    def _not_found(self, missing: list[str]) -> str:
        """What to say about them, with the command that starts them."""

    @abstractmethod
    def _served(self) -> list[str]:
        """Actions that exactly one server may have."""

    @abstractmethod
    def _halt(self) -> None:
        """Stop what is under way."""

    @abstractmethod
    def _close(self) -> None:
        """Give subscriptions and clients back."""
