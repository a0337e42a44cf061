"""The event stream of a running loop in the window: an event sink that never waits and never fails."""

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from evg_app.errors import EvgError
from evg_app.events import (
    AttemptFinished,
    AttemptStarted,
    Event,
    FrameTaken,
    Fused,
    GraspsPlanned,
    Judged,
    RoundFinished,
    RoundStarted,
    RunFinished,
    RunStarted,
    StateEntered,
    Warned,
)
from evg_app.trials.arrays import Gathered
from evg_app.trials.labels import VIEWER, add_label
from evg_app.viewer.counters import Counters
from evg_app.viewer.drawing import Stored, drawing
from evg_app.viewer.window import Window

log = logging.getLogger(__name__)

SEEN = (FrameTaken, Fused, GraspsPlanned, Judged)
"""Events that change the picture."""


@dataclass(frozen=True, eq=False)
class Moment:
    """What there is to show: the pass's arrays (None: as before), words about it, and the counters."""

    stored: Stored | None
    words: tuple[str, ...]
    counts: tuple[str, ...]


class LiveView:
    """An event sink. What cannot be drawn in time is left out; what cannot be drawn at all is logged once.

    Args:
        show: draws a moment, in a thread of its own; `shown_in(window)` for a window.
        folder: where the run is recorded, for labels.
    """

    def __init__(self, show: Callable[[Moment], None], folder: Path | None = None) -> None:
        self._show, self._folder = show, folder
        self._last: AttemptFinished | None = None
        self._gathered, self._counters = Gathered(), Counters()
        self._title, self._what, self._state, self._ended = "run", "", "", ""
        self._fresh: Moment | None = None
        self._waiting, self._over = threading.Condition(), False
        self._thread = threading.Thread(target=self._draw, name="viewer", daemon=True)
        self._thread.start()

    def __call__(self, event: Event) -> None:
        """Take one event."""
        try:
            self._take(event)
        except Exception:
            log.warning("the live view missed %s", type(event).__name__, exc_info=True)

    def label(self, success: bool | None) -> str:
        """Keep a person's word about the last executed grasp; what became of it, in words. Safe from any thread.

        The word counts as the log counts it: None leaves the automatic outcome.
        """
        last = self._last
        if last is None or self._folder is None:
            return "no grasp was executed yet"
        try:
            add_label(self._folder, last.attempt_id, success, VIEWER)
        except EvgError as error:
            return f"the label was not kept: {error}"
        self._counters = self._counters.labelled(last, success)
        self._post(None)
        return f"{last.attempt_id}: {'cannot tell' if success is None else 'success' if success else 'failure'}, kept"

    def close(self, patience: float = 2.0) -> None:
        """Draw what waits, for at most `patience` [s], and end."""
        with self._waiting:
            self._over = True
            self._waiting.notify()
        self._thread.join(timeout=patience)

    def _take(self, event: Event) -> None:
        """Keep what the event tells, and leave a moment when there is something to see."""
        self._gathered.take(event)
        self._counters = self._counters.after(event)
        if isinstance(event, RunStarted):
            self._title = event.model
        elif isinstance(event, AttemptStarted):
            self._gathered, self._ended = Gathered(), ""
            self._what = f"seed {event.seed}, round {event.round_index}, pass {event.index}"
        elif isinstance(event, StateEntered):
            self._state = f"state: {event.state}"
        elif isinstance(event, AttemptFinished):
            self._last = event if event.outcome.counts else self._last
            self._ended = f"{event.outcome}{f': {event.failure}' if event.failure else ''}"
        elif isinstance(event, RoundFinished):
            self._ended = f"round ended: {event.stop_reason}{f': {event.detail}' if event.detail else ''}"
        elif isinstance(event, RunFinished):
            self._ended = f"run {event.status}{f': {event.detail}' if event.detail else ''}"
        elif isinstance(event, Warned):
            self._ended = f"warning: {event.text}"
        elif not isinstance(event, (*SEEN, RoundStarted)):
            return
        self._post(self._gathered.arrays() if isinstance(event, SEEN) else None)

    def _post(self, stored: Stored | None) -> None:
        """Leave a moment for the drawing thread; one that it has not taken yet is replaced, its arrays kept."""
        words = tuple(word for word in (self._what, self._state, self._ended) if word)
        with self._waiting:
            if stored is None and self._fresh is not None:
                stored = self._fresh.stored
            self._fresh = Moment(stored, words, (self._title, *self._counters.lines()))
            self._waiting.notify()

    def _draw(self) -> None:
        """The drawing thread: the newest moment, until the end."""
        failed = False
        while True:
            with self._waiting:
                self._waiting.wait_for(lambda: self._fresh is not None or self._over)
                moment, self._fresh = self._fresh, None
            if moment is None:
                return
            try:
                self._show(moment)
            except Exception:
                if not failed:
                    log.warning("the live view cannot draw", exc_info=True)
                failed = True


def shown_in(window: Window) -> Callable[[Moment], None]:
    """Draws moments in a window."""

    def show(moment: Moment) -> None:
        """Draw one."""
        window.count(list(moment.counts))
        if moment.stored is None:
            window.say(list(moment.words))
        else:
            window.show(drawing(moment.stored), list(moment.words))

    return show
