"""The person in front of the robot: asked in the terminal; no answer, or no terminal, is a no."""

import argparse
import os
import select
import sys

from evg_app.cli.console import say
from evg_app.events import Answer, GraspOffered
from evg_app.picking.context import Supervisor
from evg_app.picking.stop import StopToken
from evg_app.viewer.desk import Desk

SLICE = 0.1
"""How often a question looks whether somebody stopped the run [s]."""
YES = ("y", "yes")


class Operator:
    """Asks questions on standard input.

    Args:
        stop: a run that is told to stop while a question is open takes it as a no.
        desk: where questions may be answered, too.
    """

    def __init__(self, stop: StopToken, desk: Desk | None = None) -> None:
        self._stop, self._desk = stop, desk
        self._pending, self._ended = b"", False

    @property
    def stopped(self) -> bool:
        """Whether the run was told to stop."""
        return self._stop.soft

    def confirm(self, question: str) -> bool:
        """Ask; whether the answer was yes."""
        return (self.ask(f"{question} [y/N]") or "").strip().lower() in YES

    def answer(self, question: str) -> str:
        """Ask for a line of text; empty at the end of input, or when the run is told to stop."""
        return self.ask(question) or ""

    def ready(self, question: str) -> bool:
        """Ask for Enter; False at the end of input, or when the run is told to stop."""
        return self.ask(question) is not None

    def number(self, question: str) -> int | None:
        """Ask for a whole number; None when there is no terminal or no number was given."""
        if not sys.stdin or not sys.stdin.isatty():
            return None
        text = (self.ask(question) or "").strip()
        return int(text) if text.isdecimal() else None

    def ask(self, question: str) -> str | None:
        """Ask here and at the desk; the first answer counts. None at the end of input, or when told to stop."""
        say(question)
        if self._desk is None:
            return self._line()
        self._desk.ask(question)
        try:
            return self._line()
        finally:
            self._desk.ask("")

    def _line(self) -> str | None:
        """The next line of input; None at its end, or when the run is told to stop."""
        try:
            source = sys.stdin.fileno()
        except (OSError, ValueError, AttributeError):
            return None
        while b"\n" not in self._pending:
            if self._stop.soft:
                return None
            if self._desk is not None and (typed := self._desk.typed()) is not None:
                return typed
            if not select.select([] if self._ended else [source], [], [], SLICE)[0]:
                continue
            more = os.read(source, 4096)
            self._ended = not more
            if self._ended and self._desk is None:
                return None
            self._pending += more
        line, self._pending = self._pending.split(b"\n", 1)
        return line.decode(errors="replace")


class Terminal:
    """Implements `picking.context.Supervisor` on standard input: asks before each grasp, holds at no other place.

    Args:
        operator: the person; no terminal, or the end of input, is a no to every grasp.
    """

    asks = True

    def __init__(self, operator: Operator) -> None:
        self._operator = operator

    def may_go_on(self, state: str, timeout: float) -> bool:
        """Yes."""
        return True

    def judge(self, offered: GraspOffered, timeout: float) -> Answer | None:
        """Ask, and wait for the answer however long it takes."""
        about = f"grasp {offered.index + 1}: score {offered.score:.2f}, {offered.width * 1e3:.0f} mm wide"
        line = self._operator.ask(f"{about}. [y]es, or why not:")
        if line is None and self._operator.stopped:
            return None
        said = (line or "").strip()
        return Answer(True) if said.lower() in YES else Answer(False, said or "no answer")


def supervisor(args: argparse.Namespace, desk: Desk | None, operator: Operator) -> Supervisor | None:
    """Who may hold the loop: the person at the view, or with `--confirm-grasps` the one at the terminal, or nobody."""
    if desk is not None:
        return desk
    return Terminal(operator) if args.confirm_grasps else None
