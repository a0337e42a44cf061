"""Where commands talk to the person in front of them."""

import ctypes
import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


def say(text: str) -> None:
    """Write one line to standard output; silently nothing when the terminal is gone: a run must not fail for that.

    Raises:
        OSError: a pipe is closed, a disk is full.
    """
    try:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()
    except OSError as error:
        if error.errno != errno.EIO:
            raise


@contextmanager
def hushed() -> Iterator[None]:
    """Nothing reaches the terminal meanwhile: libraries that greet on import write past `sys.stderr`."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept, nowhere = (os.dup(1), os.dup(2)), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
    finally:
        ctypes.CDLL(None).fflush(None)  # what C code has buffered must not surface later
        for stream, copy in enumerate(kept, 1):
            os.dup2(copy, stream)
            os.close(copy)
        os.close(nowhere)
