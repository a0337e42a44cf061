"""Shared state and worker processes: no torn reads, bounded waits, named ends."""

import os
import signal
import threading
import time

import numpy as np
import pytest

from evg_app.errors import DeviceTimeout, HardwareError
from evg_app.robots.fci import realtime
from evg_app.robots.fci.messages import Leave
from evg_app.robots.fci.shared import Orders, StateBlock, StateWriter
from evg_app.robots.fci.worker import Worker


def quiet(pipe) -> None:
    """Says nothing until it is told to leave."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe.recv()


def dies(pipe) -> None:
    """Ends at once."""
    os._exit(7)


def deaf(pipe) -> None:
    """Never leaves by itself."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    pipe.send("ready")
    while True:
        signal.pause()


def test_a_state_is_never_read_half_written():
    block, over = StateBlock(), threading.Event()
    writer = StateWriter(block)
    writer.write(q=np.zeros(7), dq=np.zeros(7), stamp=0.0)

    def write() -> None:
        k = 0
        while not over.is_set():
            k += 1
            writer.write(q=np.full(7, k), dq=np.full(7, -k), stamp=float(k))

    thread = threading.Thread(target=write)
    thread.start()
    try:
        for _ in range(2000):
            now = block.read()
            assert now is not None
            assert np.all(now.q == now.stamp) and np.all(now.dq == -now.stamp)
    finally:
        over.set()
        thread.join()


def test_nothing_is_read_before_the_first_state():
    assert StateBlock().read() is None


def test_an_order_to_cancel_reaches_the_motion_and_not_the_next():
    orders = Orders()
    orders.cancel(3)
    assert orders.cancelled(3) and not orders.cancelled(4)


def test_a_wait_ends_by_name():
    worker = Worker("test", quiet, (), Leave())
    try:
        with pytest.raises(DeviceTimeout, match="an answer"):
            worker.wait("an answer", 0.2)
    finally:
        worker.end()
    assert not worker.alive


def test_a_process_that_dies_is_an_error_with_its_exit_code():
    worker = Worker("test", dies, (), Leave())
    with pytest.raises(HardwareError, match=r"test process ended .*7"):
        worker.wait("an answer", 10.0)
    worker.end()


def test_a_process_that_does_not_leave_is_ended():
    worker = Worker("test", deaf, (), Leave())
    assert worker.wait("a word", 10.0) == "ready"
    start = time.monotonic()
    worker.end(timeout=0.2)
    assert not worker.alive and time.monotonic() - start < 5.0
    worker.end()


def test_a_core_is_set_apart_only_when_there_are_enough():
    assert realtime.choose_core((0, 1), None) is None
    assert realtime.choose_core((0, 1, 2, 3), None) == 3
    assert realtime.choose_core((0, 1), 1) == 1
    assert realtime.choose_core((0, 1), 5) is None


def test_advice_names_what_to_change():
    poor = realtime.Machine(False, 0, "powersave", (0, 1))
    assert [word for word in ("realtime-kernel", "rtprio", "governor") if word in " ".join(realtime.advice(poor))] == [
        "realtime-kernel",
        "rtprio",
        "governor",
    ]
    assert realtime.advice(realtime.Machine(True, 99, "performance", (0, 1, 2, 3))) == []
