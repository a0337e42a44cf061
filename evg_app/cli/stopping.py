"""Stopping from outside the terminal: a file that appears, signals, or anything that calls `stop_now`."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from evg_app.errors import Refused
from evg_app.picking.stop import ENDING, StopToken

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


@contextmanager
def ended_like_interrupted() -> Iterator[None]:
    """While inside, the signals of `ENDING` raise KeyboardInterrupt as Ctrl-C does, and all is left in order.

    Not those that are ignored (nohup); only the main thread can hear them.
    """
    in_main = threading.current_thread() is threading.main_thread()
    heard = [number for number in ENDING if in_main and signal.getsignal(number) is not signal.SIG_IGN]
    previous = {number: signal.signal(number, _interrupt) for number in heard}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def _interrupt(_signal: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
