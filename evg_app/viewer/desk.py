"""Where buttons leave what a person wants and the loop finds it: pause, step, yes or no. Safe from any thread."""

import threading
import time
from collections.abc import Callable

from evg_app.events import Answer, GraspOffered

EARLIEST = 0.4
"""An answer that comes sooner after its question was meant for the one before: a double click [s]."""


class Desk:
    """Implements `picking.context.Supervisor` for buttons, and hands on typed answers to the operator's questions.

    Nobody at the desk is no answer: the loop goes on unless it was paused, and an offered grasp waits.

    Args:
        asks: whether to be asked before each grasp, from the beginning.
        paused: whether the loop is held from the beginning.
    """

    def __init__(self, asks: bool = False, paused: bool = False) -> None:
        self._asks, self._paused, self._steps = asks, paused, 0
        self._offered: GraspOffered | None = None
        self._answer: Answer | None = None
        self._question, self._before, self._since = "", "", 0.0
        self._line: str | None = None
        self._changed = threading.Condition()
        self.listener: Callable[[], None] = _nobody
        """Called after every change, from whatever thread made it; must be quick."""

    @property
    def asks(self) -> bool:
        """Whether the loop asks before each grasp."""
        return self._asks

    @property
    def paused(self) -> bool:
        """Whether the loop is held, or will be before the next state."""
        return self._paused

    @property
    def held_before(self) -> str:
        """The state that waits for a step; empty when none does."""
        return self._before

    @property
    def offered(self) -> GraspOffered | None:
        """The grasp that waits for an answer."""
        return self._offered

    @property
    def question(self) -> str:
        """The operator's question that waits for an answer; empty when none does."""
        return self._question

    def ask_first(self, asks: bool) -> None:
        """Ask before each grasp from now on, or no more; a grasp that waits is still asked about."""
        self._set(_asks=asks)

    def pause(self, paused: bool) -> None:
        """Hold the loop before its next state, or let it go on. A motion under way goes to its end."""
        self._set(_paused=paused, _steps=0)

    def step(self) -> None:
        """Let a held loop enter one state more."""
        if self._paused and self._before:
            self._set(_steps=1)

    def answer(self, accepted: bool, reason: str = "") -> None:
        """Accept or reject the grasp that waits; nothing happens when none does."""
        if self._offered is not None and time.monotonic() - self._since >= EARLIEST:
            self._set(_answer=Answer(accepted, reason))

    def type_in(self, line: str) -> None:
        """Answer the operator's question, if one is open, as if the line was typed."""
        if self._question and time.monotonic() - self._since >= EARLIEST:
            self._set(_line=line)

    def may_go_on(self, state: str, timeout: float) -> bool:
        """Whether the loop may enter this state; waits up to `timeout` [s] when it is held."""
        if self._before != state and self._paused and not self._steps:
            self._set(_before=state)
        with self._changed:
            if self._changed.wait_for(lambda: not self._paused or self._steps > 0, timeout):
                self._steps, held = max(self._steps - 1, 0), self._before
                self._before = ""
            else:
                return False
        if held:
            self.listener()
        return True

    def judge(self, offered: GraspOffered, timeout: float) -> Answer | None:
        """What the person says about this grasp; None when nothing was said within `timeout` [s]."""
        if self._offered is not offered:
            self._set(_offered=offered, _answer=None, _since=time.monotonic())
        with self._changed:
            self._changed.wait_for(lambda: self._answer is not None, timeout)
            answer = self._answer
        if answer is not None:
            self._set(_offered=None, _answer=None)
        return answer

    def ask(self, question: str) -> None:
        """Show the operator's question; an empty one closes it."""
        self._set(_question=question, _line=None, _since=time.monotonic())

    def typed(self) -> str | None:
        """The answer to the operator's question, once there is one."""
        return self._line

    def close(self) -> None:
        """Nothing waits any more, and nobody is told of what comes."""
        self._set(_offered=None, _question="", _paused=False)
        self.listener = _nobody

    def _set(self, **values: object) -> None:
        """Change something, wake the loop, and tell the listener."""
        with self._changed:
            for name, value in values.items():
                setattr(self, name, value)
            self._changed.notify_all()
        self.listener()


def _nobody() -> None:
    """Nobody listens."""
