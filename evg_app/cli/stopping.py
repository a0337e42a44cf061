"""Stopping a run from outside the terminal: a file that appears, or anything that calls `stop_now`."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from evg_app.errors import Refused
from evg_app.picking.stop import StopToken

INTERVAL = 0.05
"""How often the stop file is looked for [s]."""


def stop_now(stop: StopToken) -> None:
    """What Ctrl-C twice does: the motion is cancelled now. Safe from any thread while a run handles Ctrl-C."""
    stop.request()
    os.kill(os.getpid(), signal.SIGINT)


@contextmanager
def stop_file(path: Path, stop: StopToken) -> Iterator[None]:
    """While inside, creating `path` stops the motion now.

    Raises:
        Refused: it exists already.
    """
    if path.exists():
        raise Refused(f"the stop file {path} exists: somebody stopped the robot. Look why, then: rm {path}")
    over = threading.Event()

    def watch() -> None:
        """Stop as soon as the file is there."""
        while not over.wait(INTERVAL):
            if path.exists():
                stop_now(stop)
                return

    watcher = threading.Thread(target=watch, name="stop file", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()
