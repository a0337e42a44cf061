"""Messages and their age, without a network."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evg_app.robots.ros2.feeds import OFFSET_WINDOW, ClockOffset, header_stamp

CLOSE_S = 1e-4


@given(st.floats(-1e6, 1e9), st.lists(st.floats(0.0, 0.05), min_size=3, max_size=30))
def test_age_is_the_delay_beyond_the_quickest_message_whatever_the_clocks_say(offset: float, delays: list[float]):
    clock, quickest = ClockOffset(), np.inf
    for k, delay in enumerate(delays):
        sent = 1e4 + 0.02 * k
        quickest = min(quickest, delay)
        arrived = sent + delay
        made = clock.local(sent + offset + 2e6, arrived)
        assert arrived - made == pytest.approx(delay - quickest, abs=1e-5)


def test_clock_drift_is_not_taken_for_delay():
    clock, age = ClockOffset(), 0.0
    for k in range(40000):
        arrived = 100.0 + 0.1 * k
        age = max(age, arrived - clock.local(arrived * (1 - 1e-4), arrived))
    assert age < 2 * OFFSET_WINDOW * 1e-4 + CLOSE_S


def test_a_message_without_a_stamp_counts_as_made_on_arrival():
    assert ClockOffset().local(0.0, 12.5) == 12.5


def test_stamp_is_read_from_the_first_bytes():
    little = b"\x00\x01\x00\x00" + struct.pack("<iI", 1700000000, 250_000_000) + b"rest"
    big = b"\x00\x00\x00\x00" + struct.pack(">iI", 1700000000, 250_000_000)
    assert header_stamp(little) == header_stamp(big) == pytest.approx(1700000000.25)
