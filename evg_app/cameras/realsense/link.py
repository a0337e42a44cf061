"""One running librealsense pipeline: a device or a recording, frame by frame, every wait bounded."""

import atexit
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evg_app.cameras.realsense.devices import CameraInfo, info_of, is_present
from evg_app.cameras.realsense.filters import smoothing
from evg_app.cameras.realsense.optics import streams_of
from evg_app.cameras.realsense.stamps import StampMapper, Timebase, exposure_lead
from evg_app.cameras.realsense.start import Recording, last_words, start_device, start_recording
from evg_app.clock import Clock
from evg_app.config.camera import CameraConfig
from evg_app.errors import BadInput

SLICE_MS = 100
"""Longest wait inside librealsense [ms]; Ctrl-C is heard between two."""
AFTER_END = 3
"""Waits in vain after which nothing is on its way any more from a recording that has ended."""
STOP_TIMEOUT = 2.0
"""A dead pipeline may hang when it is stopped; it is left behind after this long [s]."""
EXIT_TIMEOUT = 10.0
"""How long the end of the program waits for a pipeline that was left behind [s]; librealsense aborts otherwise."""
IN_STEP = 0.6
"""Colour belongs to a depth frame when their time stamps differ by at most this share of a frame period."""


@dataclass(frozen=True)
class Shot:
    """One new depth frame and what came with it.

    Attributes:
        frameset: librealsense's own, kept alive for alignment.
        stamp: when the exposure began [s, `Clock.now`].
        number: the device's frame counter.
        in_step: the colour image belongs to the same exposure.
    """

    frameset: Any
    stamp: float
    number: int
    in_step: bool


class Link:
    """A started pipeline.

    Args:
        rs: the module `pyrealsense2`.
        config: what is asked of the device.
        clock: for the stamps and the waits.
        recording: play this instead of a device.
        serial: which device, "" for the only one.
        record_to: also write everything to this .db3 file.
        epoch: seconds since 1970.

    Attributes:
        info: what the device says of itself.
        settings: what its depth sensor was set to, read back.
        streams: optics and rate.
        dropped: depth frames that the device counted and that never arrived.

    Raises:
        BadInput, StartFailed, HardwareError: as `start_recording` and `start_device`.
    """

    def __init__(
        self,
        rs: Any,
        config: CameraConfig,
        clock: Clock,
        recording: Recording | None = None,
        serial: str = "",
        record_to: Path | None = None,
        epoch: Callable[[], float] = time.time,
    ) -> None:
        self._rs, self._config, self._clock, self._recording, self._epoch = rs, config, clock, recording, epoch
        self._pipeline = rs.pipeline()
        self.settings: Mapping[str, float] = {}
        if recording is None:
            profile, self.settings = start_device(rs, self._pipeline, config, serial, record_to)
        else:
            profile = start_recording(rs, self._pipeline, recording)
        self.info: CameraInfo = info_of(rs, profile.get_device())
        try:
            self.streams = streams_of(rs, profile)
        except RuntimeError as error:
            self.stop()
            raise BadInput(f"{self._name()} does not describe its streams: {last_words(error)}") from error
        self._playback = None if recording is None else profile.get_device().as_playback()
        self._align = rs.align(rs.stream.depth) if self.streams.color is not None else None
        self._smoothing = smoothing(rs, config)
        self._mappers: dict[Timebase, StampMapper] = {}
        self._pending: Any = None
        self._delivered: tuple[int, float] | None = None
        self.dropped = 0

    def next(self, seconds: float) -> Shot | None:
        """The next depth frame that was not given before, with the colour of the same exposure if it comes.

        Waits at most `seconds` [s] and one frame period; None when nothing new arrived.
        """
        frameset = self._pending or self._pull(seconds)
        self._pending = None
        if frameset is None:
            return None
        if self.streams.color is not None and not self._in_step(frameset):
            later = self._pull(1.5 * self.streams.period)
            if later is not None and _key(later) == _key(frameset):
                frameset = later
            else:
                self._pending = later
        depth = frameset.get_depth_frame()
        if self._delivered is not None and depth.frame_number > self._delivered[0] + 1:
            self.dropped += depth.frame_number - self._delivered[0] - 1
        self._delivered = _key(frameset)
        return Shot(frameset, self._stamp(depth), int(depth.frame_number), self._in_step(frameset))

    def _pull(self, seconds: float) -> Any:
        """A frameset with a depth frame other than the last one given, or None."""
        deadline, empty = self._clock.now() + seconds, 0
        while empty < AFTER_END:
            left = deadline - self._clock.now()
            if left <= 0:
                return None
            arrived, frameset = self._pipeline.try_wait_for_frames(max(1, min(SLICE_MS, int(left * 1e3))))
            if arrived and frameset.get_depth_frame() and _key(frameset) != self._delivered:
                return frameset
            empty = empty + 1 if not arrived and self.ended else 0
        return None

    def _in_step(self, frameset: Any) -> bool:
        """Whether colour and depth are of the same exposure."""
        color = frameset.get_color_frame()
        if not color:
            return False
        apart = abs(color.timestamp - frameset.get_depth_frame().timestamp) * 1e-3
        return bool(apart <= IN_STEP * self.streams.period)

    def _stamp(self, depth: Any) -> float:
        """When the exposure began, on our clock [s]."""
        own = depth.get_frame_timestamp_domain() == self._rs.timestamp_domain.hardware_clock
        base = Timebase.RECORDED if self._recording else Timebase.DEVICE if own else Timebase.EPOCH
        mapper = self._mappers.setdefault(base, StampMapper(base, self._epoch))  # the first frames may lack global time
        lead = exposure_lead(self._rs, depth, self.streams.period)
        return mapper.stamp(depth.timestamp * 1e-3, self._clock.now(), lead)

    def depth(self, shot: Shot) -> NDArray[np.uint16]:
        """Raw depth of a shot, smoothed when the config asks for it; 0 outside of the measuring range. Shape (H, W)."""
        frame = shot.frameset.get_depth_frame()
        for block in self._smoothing:
            frame = block.process(frame)
        raw = np.array(frame.get_data(), dtype=np.uint16)
        scale = self.streams.depth_scale
        raw[(raw < self._config.near_m / scale) | (raw > self._config.far_m / scale)] = 0
        return raw

    def aligned_color(self, shot: Shot) -> NDArray[np.uint8] | None:
        """Colour of the same exposure, registered to the depth image; None when there is none. Shape (H, W, 3)."""
        if self._align is None or not shot.in_step:
            return None
        return np.array(self._align.process(shot.frameset).get_color_frame().get_data(), dtype=np.uint8)

    def color(self, shot: Shot) -> NDArray[np.uint8] | None:
        """Colour of the same exposure as it was taken; None when there is none. Shape (H, W, 3)."""
        return np.array(shot.frameset.get_color_frame().get_data(), dtype=np.uint8) if shot.in_step else None

    @property
    def ended(self) -> bool:
        """Whether this is a recording that was read to its end; frames may still be on their way."""
        stopped = self._rs.playback_status.stopped
        return self._playback is not None and bool(self._playback.current_status() == stopped)

    def lost(self) -> str:
        """Why no frame can come any more, "" when one can."""
        if self._playback is not None:
            return f"{self._name()} has ended" if self.ended else ""
        if is_present(self._rs, self.info.serial):
            return ""
        return f"{self._name()} has left USB: unplugged, or its cable, hub or power failed"

    def stop(self) -> None:
        """Stop the pipeline, waiting at most `STOP_TIMEOUT` for a dead one; may be called twice."""
        pipeline, self._pipeline, self._pending = self._pipeline, None, None
        if pipeline is None:
            return
        worker = threading.Thread(target=_stop, args=(pipeline,), daemon=True, name="stop of a RealSense pipeline")
        worker.start()
        worker.join(STOP_TIMEOUT)
        if worker.is_alive():
            atexit.register(worker.join, EXIT_TIMEOUT)

    def _name(self) -> str:
        """How messages call it."""
        return f"camera {self.info.serial}" if self._recording is None else f"recording {self._recording.path}"


def _stop(pipeline: Any) -> None:
    """Stop a pipeline; one that never ran is none to stop."""
    try:
        pipeline.stop()
    except RuntimeError:
        return  # it never ran, or its device is gone: there is nothing left to stop


def _key(frameset: Any) -> tuple[int, float]:
    """Number and time stamp of a frameset's depth."""
    depth = frameset.get_depth_frame()
    return int(depth.frame_number), float(depth.timestamp)
