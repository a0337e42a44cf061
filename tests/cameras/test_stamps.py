"""A stamp is never later than the exposure began: an old frame must not look fresh."""

from types import SimpleNamespace

import numpy as np
import pyrealsense2 as rs
import pytest

from evg_app.cameras.realsense.stamps import LATENCY, WINDOW, StampMapper, Timebase, exposure_lead

EPOCH = 1.7e9
"""Seconds since 1970 when the clock of evg-app was 0."""
EXACT_S = 1e-6


def test_global_time_is_exact_and_less_the_exposure():
    now = 50.0
    mapper = StampMapper(Timebase.EPOCH, lambda: EPOCH + now)
    assert mapper.stamp(EPOCH + 49.9, now, lead=0.01) == pytest.approx(49.89, abs=EXACT_S)


def test_cameras_own_clock_never_gives_a_later_stamp_than_the_exposure():
    rng = np.random.default_rng(0)
    mapper = StampMapper(Timebase.DEVICE, lambda: EPOCH)
    for n in range(300):
        exposed = n / 30
        delay = 0.05 + rng.exponential(0.03)
        stamp = mapper.stamp(1e4 + exposed, exposed + delay, lead=0.0)
        assert stamp <= exposed + EXACT_S or n < 5
    assert exposed - LATENCY < stamp


def test_drift_of_the_cameras_clock_is_followed():
    mapper = StampMapper(Timebase.DEVICE, lambda: EPOCH)
    for n in range(100 * WINDOW):
        exposed = n / 30
        stamp = mapper.stamp(exposed * (1 - 1e-4), exposed + LATENCY, lead=0.0)
    assert stamp == pytest.approx(exposed, abs=1e-3)


def test_recording_that_begins_again_is_anchored_anew():
    mapper = StampMapper(Timebase.RECORDED, lambda: EPOCH)
    assert mapper.stamp(100.0, 5.0, lead=0.03) == 5.0
    assert mapper.stamp(100.5, 5.6, lead=0.03) == pytest.approx(5.5)
    assert mapper.stamp(100.0, 7.0, lead=0.03) == 7.0


def frame(**metadata):
    """A depth frame with this metadata."""
    known = {getattr(rs.frame_metadata_value, key): value for key, value in metadata.items()}
    return SimpleNamespace(supports_frame_metadata=known.__contains__, get_frame_metadata=known.__getitem__)


def test_lead_is_from_the_start_of_the_exposure_to_the_readout():
    taken = frame(frame_timestamp=1_020_000, sensor_timestamp=1_008_000, actual_exposure=8_000)
    assert exposure_lead(rs, taken, 1 / 30) == pytest.approx(0.016)
    assert exposure_lead(rs, frame(frame_timestamp=1_020_000, sensor_timestamp=1_008_000), 1 / 30) == pytest.approx(
        0.012
    )
    assert exposure_lead(rs, frame(), 1 / 30) == 1 / 30
