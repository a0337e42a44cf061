"""How a person stops the loop: once to finish safely, twice to stop now."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from evg_app.errors import Stopped

ENDING = (signal.SIGTERM, signal.SIGHUP)
"""What ends a program from outside: `kill` or a service manager; its terminal closed or its connection was lost."""


class StopToken:
    """Counts requests to stop. The loop looks at it between states and in every wait."""

    def __init__(self) -> None:
        self._level = 0
        self._shields = 0

    @property
    def soft(self) -> bool:
        """Somebody asked: finish the attempt safely, then end."""
        return self._level >= 1

    @property
    def hard(self) -> bool:
        """Somebody asked twice: stop the motion now."""
        return self._level >= 2

    def request(self) -> None:
        """Ask once (more). Safe from any thread."""
        self._level += 1

    def request_soft(self) -> None:
        """Ask once, unless somebody asked already."""
        self._level = max(self._level, 1)

    def check(self) -> None:
        """Pass unless asked twice.

        Raises:
            Stopped: asked twice, and not shielded.
        """
        if self.hard and not self._shields:
            raise Stopped("stopped by the user; motion cancelled, gripper left as it was")

    @contextmanager
    def shielded(self) -> Iterator[None]:
        """No `Stopped` from a signal inside (log writes, cleanup); it is raised by the next `check`."""
        self._shields += 1
        try:
            yield
        finally:
            self._shields -= 1

    @contextmanager
    def on_signals(self) -> Iterator[None]:
        """Ctrl-C asks this token. The second one raises `Stopped` out of whatever the main thread does.

        One of `ENDING` counts as two, unless it is ignored (nohup).
        """
        heard = [number for number in ENDING if signal.getsignal(number) is not signal.SIG_IGN]
        handlers = {signal.SIGINT: self._interrupted} | dict.fromkeys(heard, self._ended)
        previous = {number: signal.signal(number, handler) for number, handler in handlers.items()}
        try:
            yield
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)

    def _interrupted(self, _signal: int, _frame: FrameType | None) -> None:
        """Handler of Ctrl-C."""
        self.request()
        self.check()

    def _ended(self, _signal: int, _frame: FrameType | None) -> None:
        """Handler of `ENDING`."""
        self.request()
        self.request()
        self.check()
