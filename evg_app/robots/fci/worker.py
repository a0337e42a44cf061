"""A process of its own at the end of a pipe: started, asked, watched and ended; every wait has a name and a timeout."""

import contextlib
import multiprocessing
import time
from collections.abc import Callable
from typing import Any

from evg_app.errors import DeviceTimeout, HardwareError

SLICE = 0.05
"""Longest uninterruptible wait [s]; a Ctrl-C is handled in between."""
LEAVE_TIMEOUT = 3.0
"""How long a process may take to leave before it is ended [s]."""


class Worker:
    """One process and its pipe.

    Args:
        name: how messages call it.
        target: what runs there: takes the pipe's other end and `arguments`; must ignore SIGINT.
        arguments: picklable, or shared memory.
        stop: how to ask it to leave.
    """

    def __init__(self, name: str, target: Callable[..., None], arguments: tuple[Any, ...], stop: object) -> None:
        context = multiprocessing.get_context("spawn")
        self._name, self._stop = name, stop
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=target, args=(theirs, *arguments), name=f"evg-{name}", daemon=True)
        self.process.start()
        theirs.close()

    def send(self, message: object) -> None:
        """Put a message into the pipe.

        Raises:
            HardwareError: the process is gone.
        """
        try:
            self.connection.send(message)
        except (OSError, ValueError) as error:
            raise self._gone() from error

    def poll(self, timeout: float) -> object | None:
        """The next message, waiting at most `timeout` [s]; None when there is none.

        Raises:
            HardwareError: the process is gone.
        """
        end = time.monotonic() + timeout
        try:
            while True:
                left = max(end - time.monotonic(), 0.0)
                if self.connection.poll(min(left, SLICE)):
                    message: object = self.connection.recv()
                    return message
                if left <= SLICE:
                    return None
        except (EOFError, OSError) as error:
            raise self._gone() from error

    def wait(self, what: str, timeout: float, advice: str = "") -> object:
        """The next message.

        Raises:
            DeviceTimeout: none came within `timeout` [s].
            HardwareError: the process is gone.
        """
        message = self.poll(timeout)
        if message is None:
            raise DeviceTimeout(what, timeout, advice)
        return message

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self.process.is_alive()

    def end(self, timeout: float = LEAVE_TIMEOUT) -> None:
        """Ask the process to leave, and end it when it does not within `timeout` [s]. May be called repeatedly."""
        with contextlib.suppress(OSError, ValueError):
            self.connection.send(self._stop)
        self.process.join(timeout)
        for stop in (self.process.terminate, self.process.kill):
            if self.process.is_alive():
                stop()
                self.process.join(1.0)
        self.connection.close()

    def _gone(self) -> HardwareError:
        """The error for a process that has ended."""
        self.process.join(0.5)
        return HardwareError(
            f"the {self._name} process ended unexpectedly (exit code {self.process.exitcode}); the robot's controller "
            "stops the arm by itself when commands stop coming. Run the command again"
        )
