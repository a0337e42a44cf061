"""A fault in the middle of `evg-app run`: injected when a motion is under way, and what the run made of it."""

import contextlib
import json
import os
import signal
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

from evg_app.cli import progress
from evg_app.cli.main import main as evg_app
from evg_app.events import Event, GripperMoved, MotionEnded, MotionStarted, RunFinished, StateEntered, Warned

COLUMNS = ("outcome", "failure", "evidence", "motion_s", "compute_ms", "arrays")
"""What a complete row of an attempt has."""
NOTICED = ("device error", "gave up", "recovering")


@dataclass
class Injection:
    """Hurts the wire `delay` [s] after a motion of this name was announced, or a state entered, and listens.

    With no delay it is hurt before the motion is sent.

    Attributes:
        began, noticed: when the wire was hurt, and when the run knew, monotonic [s].
        said: what it said then.
        moved_on: names of the motions that were sent afterwards.
    """

    at: str
    hurt: Callable[[], object]
    delay: float = 0.4
    began: float | None = None
    noticed: float | None = None
    said: str = ""
    moved_on: list[str] = field(default_factory=list)
    _timer: threading.Timer | None = None

    def __call__(self, event: Event) -> None:
        """Take one event of the run."""
        if isinstance(event, MotionStarted) and self.began is not None:
            self.moved_on.append(event.name)
        name = event.name if isinstance(event, MotionStarted) else ""
        name = f"state {event.state}" if isinstance(event, StateEntered) else name
        if name == self.at and self._timer is None:
            self._timer = threading.Timer(self.delay, self._now)
            (self._timer.start if self.delay else self._now)()
        elif self.began is not None and self.noticed is None:
            self._look(event)

    def done(self) -> None:
        """Wait until the hurting itself has ended."""
        if self._timer is not None and self._timer.is_alive():
            self._timer.join()

    def _now(self) -> None:
        self.began = time.monotonic()
        self.hurt()

    def _look(self, event: Event) -> None:
        if isinstance(event, MotionEnded) and not event.result.reached:
            self._known(event.result.reason)
        elif isinstance(event, Warned) and event.cause in NOTICED:
            self._known(event.text)
        elif isinstance(event, GripperMoved) and not event.result.success:
            self._known(event.result.message)
        elif isinstance(event, RunFinished) and event.status != "finished":
            self._known(event.detail)

    def _known(self, text: str) -> None:
        self.noticed, self.said = time.monotonic(), text

    @property
    def seconds(self) -> float:
        """From the fault to the run's knowing it [s]."""
        assert self.began is not None, "the fault was never injected"
        assert self.noticed is not None, "the fault was never noticed"
        return self.noticed - self.began


@contextlib.contextmanager
def heard_by(listen: Callable[[Event], None]) -> Iterator[None]:
    """While inside, `listen` hears the events of `evg-app run`."""

    class Told(progress.Progress):
        """Progress that also tells `listen`."""

        def __call__(self, event: Event) -> None:
            """Take one event."""
            listen(event)
            super().__call__(event)

    with mock.patch.object(progress, "Progress", Told):
        yield


def run(words: list[str], folder: Path, injection: Injection) -> int:
    """`evg-app run` in this process, hurt; its exit code."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # whoever runs the tests may ignore it
    try:
        with heard_by(injection), mock.patch("sys.stdin", None):
            code = evg_app(["run", *words, "--run-dir", str(folder)])
    finally:
        signal.signal(signal.SIGHUP, before)
    injection.done()
    return code


def rows(folder: Path) -> list[dict[str, Any]]:
    """Every attempt in the log."""
    log = sqlite3.connect(folder / "trials.sqlite")
    log.row_factory = sqlite3.Row
    return [dict(row) for row in log.execute("SELECT * FROM attempts ORDER BY attempt_index")]


def complete(row: dict[str, Any]) -> bool:
    """Whether nothing is missing in the row of an attempt."""
    return None not in [row[key] for key in COLUMNS] and bool(json.loads(row["evidence"]))


def ended(folder: Path) -> tuple[str, str]:
    """Status and detail of the run in its log."""
    log = sqlite3.connect(folder / "trials.sqlite")
    status, detail = log.execute("SELECT status, detail FROM runs").fetchone()
    return str(status), str(detail)


def interrupt_twice() -> None:
    """As a person who presses Ctrl-C twice."""
    for _ in range(2):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.05)


def close_terminal() -> None:
    """As when the terminal is closed or its connection is lost."""
    os.kill(os.getpid(), signal.SIGHUP)


def terminate() -> None:
    """As `kill` or a service manager."""
    os.kill(os.getpid(), signal.SIGTERM)
