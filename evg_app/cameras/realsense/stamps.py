"""Time stamps of the camera on the clock of evg-app, never later than the exposure began."""

from collections import deque
from collections.abc import Callable
from enum import Enum
from typing import Any

WINDOW = 90
"""Frames over which the quickest one tells the offset between two clocks."""
LATENCY = 0.1
"""The quickest of `WINDOW` frames is taken to arrive at most this long after its exposure began [s]."""


class Timebase(Enum):
    """How a stream's time stamps are to be read."""

    EPOCH = "seconds since 1970 on this machine"
    DEVICE = "the camera's own clock"
    RECORDED = "a recording that is played now"


class StampMapper:
    """Maps time stamps of one stream to `Clock.now`.

    With global time the camera's stamps are the machine's; otherwise the frame that arrived quickest
    tells the offset, less `LATENCY` so that an old frame never looks fresh.
    """

    def __init__(self, timebase: Timebase, epoch: Callable[[], float]) -> None:
        self._timebase, self._epoch = timebase, epoch
        self._offsets: deque[float] = deque(maxlen=WINDOW)
        self._last = float("-inf")

    def stamp(self, seconds: float, now: float, lead: float) -> float:
        """When the exposure began [s, `Clock.now`].

        Args:
            seconds: the frame's time stamp [s].
            now: when the frame arrived [s, `Clock.now`].
            lead: from the start of exposure to the time stamp [s].
        """
        if self._timebase is Timebase.EPOCH:
            return now - (self._epoch() - seconds) - lead
        if seconds < self._last:
            self._offsets.clear()
        self._last = seconds
        self._offsets.append(now - seconds)
        if self._timebase is Timebase.RECORDED:
            return min(self._offsets) + seconds
        return min(self._offsets) + seconds - lead - LATENCY


def exposure_lead(rs: Any, depth: Any, period: float) -> float:
    """Time from the start of a frame's exposure to its time stamp [s]; one `period` where the device does not tell.

    The stamp is taken at readout, the metadata `sensor_timestamp` in the middle of the exposure.
    """
    keys = rs.frame_metadata_value
    if not all(depth.supports_frame_metadata(key) for key in (keys.frame_timestamp, keys.sensor_timestamp)):
        return period
    lead = depth.get_frame_metadata(keys.frame_timestamp) - depth.get_frame_metadata(keys.sensor_timestamp)
    if depth.supports_frame_metadata(keys.actual_exposure):
        lead += 0.5 * depth.get_frame_metadata(keys.actual_exposure)
    return float(lead) * 1e-6
