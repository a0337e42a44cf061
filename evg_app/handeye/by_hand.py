"""Samples where a person guides the arm: the picture is shown all the time, each key press takes a sample."""

from collections.abc import Callable

from evg_app.errors import BadInput
from evg_app.handeye.collect import Bench, OnSample
from evg_app.handeye.sample import Sample, Session

END = "q"


def collect_by_hand(bench: Bench, key: Callable[[], str | None], preview: OnSample) -> Session:
    """Take a sample at each key press until `END`.

    Args:
        bench: the devices.
        key: waits a moment for a line of the person; None when there was none yet.
        preview: is shown what the camera sees in between; nothing of it is kept.

    Raises:
        BadInput: no sample was taken.
        HardwareError: the arm or the camera failed.
    """
    samples: list[Sample] = []
    while (line := key()) is None or line.strip().lower() != END:
        if line is None:
            preview(*bench.look(len(samples)))
        else:
            samples.append(bench.take(len(samples)))
    if not samples:
        raise BadInput("no sample was taken; press Enter at each pose, and q at the end")
    return bench.session(samples)
