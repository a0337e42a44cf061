"""The buttons of the live view: pause, step, accept or reject a grasp, answer the operator's questions, label, stop."""

from collections.abc import Callable
from typing import Any

from evg_app.viewer import text
from evg_app.viewer.desk import Desk
from evg_app.viewer.text import LABELS
from evg_app.viewer.window import Window

PAUSE, GO_ON = "pause", "go on"
ACCEPT, REJECT = "accept", "reject, offer the next best"
TYPED = {"yes": "y", "no": "n", "cannot tell": "?", "ready": ""}
"""Buttons under a question of the operator's, and what they type."""


class Controls:
    """Buttons in a window, wired to a desk; each one can be pressed only when it means something.

    Args:
        window: where they are put.
        desk: where they leave what was pressed.
        stop: asks the loop to stop: once after this pass, twice now. Called from another thread.
        label: keeps a person's word about the last finished pass.
    """

    def __init__(
        self, window: Window, desk: Desk, stop: Callable[[], None], label: Callable[[bool | None], str]
    ) -> None:
        gui: Any = window.server.gui
        self._desk, self._label = desk, label
        self._stop = gui.add_button("stop after this pass; again: now", color="red", order=1)
        self._stop.on_click(lambda _: stop())
        self._pause = gui.add_button(PAUSE, order=2)
        self._pause.on_click(lambda _: desk.pause(not desk.paused))
        self._step = gui.add_button("step: one state", order=3)
        self._step.on_click(lambda _: desk.step())
        self._asks = gui.add_checkbox("ask before each grasp", desk.asks, order=4)
        self._asks.on_update(lambda _: desk.ask_first(bool(self._asks.value)))
        self._says = gui.add_html("", order=5)
        self._why = gui.add_text("why not", "", order=6)
        self._accept = gui.add_button(ACCEPT, color="green", order=7)
        self._accept.on_click(lambda _: desk.answer(True))
        self._reject = gui.add_button(REJECT, color="orange", order=8)
        self._reject.on_click(lambda _: self._rejected())
        self._typed = gui.add_button_group("answer", tuple(TYPED), order=9)
        self._typed.on_click(lambda _: desk.type_in(TYPED[str(self._typed.value)]))
        self._labels = gui.add_button_group("last grasp", tuple(LABELS), order=25)
        self._kept = gui.add_html("", order=26)
        self._labels.on_click(lambda _: self._labelled(str(self._labels.value)))
        desk.listener = self.refresh
        self.refresh()

    def refresh(self) -> None:
        """Show what waits, and which buttons mean something."""
        desk = self._desk
        waits = desk.offered is not None
        self._pause.label = GO_ON if desk.paused else PAUSE
        self._step.disabled = not (desk.paused and desk.held_before)
        for handle in (self._accept, self._reject, self._why):
            handle.visible = waits
        self._typed.visible = bool(desk.question)
        lines = said(desk)
        self._says.content = text.lines(lines) if lines else ""

    def _rejected(self) -> None:
        """Reject with the reason that stands in the field, and empty it."""
        self._desk.answer(False, str(self._why.value).strip() or "no reason given")
        self._why.value = ""

    def _labelled(self, word: str) -> None:
        """Keep a label, and say what became of it."""
        self._kept.content = text.lines([self._label(LABELS[word])])


def said(desk: Desk) -> list[str]:
    """What waits for the person, in words."""
    lines = []
    if desk.offered is not None:
        offered = desk.offered
        lines.append(f"execute the yellow grasp? score {offered.score:.2f}, {offered.width * 1e3:.0f} mm")
    if desk.question:
        lines.append(desk.question)
    if desk.paused:
        lines.append(f"held before '{desk.held_before}'" if desk.held_before else "will be held before the next state")
    return lines
