"""Values that several verbs take on the command line."""

import argparse
import os


def count(text: str) -> int:
    """A whole number from 1 up."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def port(text: str) -> int:
    """A TCP port; 0 is any free one."""
    value = int(text)
    if not 0 <= value <= 65535:
        raise argparse.ArgumentTypeError("must be between 0 (any free one) and 65535")
    return value


def seeds(text: str) -> tuple[int, ...]:
    """One seed, or several with commas between."""
    found = tuple(int(word) for word in text.split(","))
    if min(found) < 0 or len(set(found)) < len(found):
        raise argparse.ArgumentTypeError("must be different whole numbers from 0 up")
    return found


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
