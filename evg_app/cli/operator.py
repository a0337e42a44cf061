"""The person in front of the robot: asked in the terminal; no answer, or no terminal, is a no."""

import os
import select
import sys

from evg_app.cli.console import say
from evg_app.picking.stop import StopToken

SLICE = 0.1
"""How often a question looks whether somebody stopped the run [s]."""
YES = ("y", "yes")


class Operator:
    """Asks questions on standard input.

    Args:
        stop: a run that is told to stop while a question is open takes it as a no.
    """

    def __init__(self, stop: StopToken) -> None:
        self._stop = stop
        self._pending = b""

    def confirm(self, question: str) -> bool:
        """Ask; whether the answer was yes."""
        say(f"{question} [y/N]")
        return (self._line() or "").strip().lower() in YES

    def answer(self, question: str) -> str:
        """Ask for a line of text; empty at the end of input, or when the run is told to stop."""
        say(question)
        return self._line() or ""

    def ready(self, question: str) -> bool:
        """Ask for Enter; False at the end of input, or when the run is told to stop."""
        say(question)
        return self._line() is not None

    def number(self, question: str) -> int | None:
        """Ask for a whole number; None when there is no terminal or no number was given."""
        if not sys.stdin or not sys.stdin.isatty():
            return None
        say(question)
        text = (self._line() or "").strip()
        return int(text) if text.isdecimal() else None

    def _line(self) -> str | None:
        """The next line of input; None at its end, or when the run is told to stop."""
        try:
            source = sys.stdin.fileno()
        except (OSError, ValueError, AttributeError):
            return None
        while b"\n" not in self._pending:
            if self._stop.soft:
                return None
            if not select.select([source], [], [], SLICE)[0]:
                continue
            more = os.read(source, 4096)
            if not more:
                return None
            self._pending += more
        line, self._pending = self._pending.split(b"\n", 1)
        return line.decode(errors="replace")
