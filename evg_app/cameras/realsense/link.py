"""One running librealsense pipeline: a device or a recording, frame by frame, every wait bounded."""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evg_app.cameras.realsense.devices import CameraInfo, choose, info_of, is_present
from evg_app.cameras.realsense.optics import intrinsics_of, transform_of
from evg_app.cameras.realsense.settings import apply_settings
from evg_app.cameras.realsense.stamps import StampMapper, Timebase
from evg_app.clock import Clock
from evg_app.config.camera import CameraConfig
from evg_app.errors import BadInput, HardwareError
from evg_app.geometry import Array

SLICE_MS = 100
"""Longest wait inside librealsense [ms]; Ctrl-C is heard between two."""
STOP_TIMEOUT = 2.0
"""A dead pipeline may hang when it is stopped; it is left behind after this long [s]."""


@dataclass(frozen=True)
class Recording:
    """A .db3 file that stands in for the device. `real_time` False gives every frame as fast as it is asked for."""

    path: Path
    repeat: bool = False
    real_time: bool = True


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


class StartFailed(HardwareError):
    """The camera is there but did not start; another attempt or a reset may help."""


class Link:
    """A started pipeline.

    Args:
        rs: the module `pyrealsense2`.
        config: what is asked of the device.
        clock: for the stamps and the waits.
        recording: play this instead of a device.
        serial: which device, "" for the only one.
        record_to: also write everything to this .db3 file.

    Raises:
        BadInput: the recording cannot be played, or the device refuses a setting.
        StartFailed: the device is there and did not start.
        HardwareError: no such device, streams not offered, or somebody else has it.
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
        self._rs, self._config, self._clock, self._recording = rs, config, clock, recording
        self._pipeline = rs.pipeline()
        self.settings: Mapping[str, float] = {}
        profile = self._start_device(serial, record_to) if recording is None else self._start_recording(recording)
        self.info: CameraInfo = info_of(rs, profile.get_device())
        try:
            self._streams(profile)
        except RuntimeError as error:
            self.stop()
            raise BadInput(f"{self._name()} does not describe its streams: {_last_words(error)}") from error
        self._epoch = epoch
        self._mapper: StampMapper | None = None
        self._pending: Any = None
        self._delivered: tuple[int, float] | None = None
        self.dropped = 0
        """Depth frames that the device counted and that never arrived."""

    def _start_recording(self, recording: Recording) -> Any:
        setup = self._rs.config()
        try:
            setup.enable_device_from_file(str(recording.path), recording.repeat)
            profile = self._pipeline.start(setup)
        except RuntimeError as error:
            raise BadInput(
                f"recording {recording.path} cannot be played: {_last_words(error)}. "
                "Name a .db3 file made by: evg-app camera record"
            ) from error
        profile.get_device().as_playback().set_real_time(recording.real_time)
        return profile

    def _start_device(self, serial: str, record_to: Path | None) -> Any:
        rs, wanted = self._rs, self._config.realsense
        info = choose(rs, serial)
        setup = rs.config()
        setup.enable_device(info.serial)
        setup.enable_stream(rs.stream.depth, self._config.width_px, self._config.height_px, rs.format.z16, wanted.fps)
        if wanted.color is not None:
            size = wanted.color.width_px, wanted.color.height_px
            setup.enable_stream(rs.stream.color, *size, rs.format.rgb8, wanted.fps)
        if record_to is not None:
            setup.enable_record_to_file(str(record_to))
        try:
            resolved = setup.resolve(rs.pipeline_wrapper(self._pipeline))
            self.settings = apply_settings(rs, resolved.get_device().first_depth_sensor(), wanted)
            return self._pipeline.start(setup)
        except RuntimeError as error:
            raise _start_problem(_last_words(error), info, self._config) from error

    def _streams(self, profile: Any) -> None:
        rs = self._rs
        streams = {
            stream.stream_type(): stream.as_video_stream_profile()
            for stream in profile.get_streams()
            if stream.is_video_stream_profile()
        }
        if rs.stream.depth not in streams:
            raise RuntimeError("there is no depth stream")
        depth, color = streams[rs.stream.depth], streams.get(rs.stream.color)
        self.intrinsics = intrinsics_of(rs, depth.get_intrinsics())
        self.depth_scale = float(profile.get_device().first_depth_sensor().get_depth_scale())
        self.period = 1.0 / depth.fps()
        self.color_intrinsics = None if color is None else intrinsics_of(rs, color.get_intrinsics())
        self.T_color_depth: Array | None = None if color is None else transform_of(depth.get_extrinsics_to(color))
        self._playback = None if self._recording is None else profile.get_device().as_playback()
        self._align = rs.align(rs.stream.depth) if color is not None else None
        self._smoothing = _smoothing(rs, self._config)

    def _name(self) -> str:
        return f"camera {self.info.serial}" if self._recording is None else f"recording {self._recording.path}"

    def next(self, seconds: float) -> Shot | None:
        """The next depth frame that was not given before, with the colour of the same exposure if it comes.

        Waits at most `seconds` [s] and one frame period; None when nothing new arrived.
        """
        frameset = self._pending or self._pull(seconds)
        self._pending = None
        if frameset is None:
            return None
        if self.color_intrinsics is not None and not self._in_step(frameset):
            later = self._pull(1.5 * self.period)
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
        deadline = self._clock.now() + seconds
        while True:
            left = deadline - self._clock.now()
            if left <= 0:
                return None
            arrived, frameset = self._pipeline.try_wait_for_frames(max(1, min(SLICE_MS, int(left * 1e3))))
            if arrived and frameset.get_depth_frame() and _key(frameset) != self._delivered:
                return frameset

    def _in_step(self, frameset: Any) -> bool:
        color = frameset.get_color_frame()
        if not color:
            return False
        return bool(abs(color.timestamp - frameset.get_depth_frame().timestamp) <= 0.6e3 * self.period)

    def _stamp(self, depth: Any) -> float:
        rs, keys = self._rs, self._rs.frame_metadata_value
        if self._mapper is None:
            device = depth.get_frame_timestamp_domain() == rs.timestamp_domain.hardware_clock
            base = Timebase.RECORDED if self._recording else Timebase.DEVICE if device else Timebase.EPOCH
            self._mapper = StampMapper(base, self._epoch)
        lead = self.period
        if all(depth.supports_frame_metadata(k) for k in (keys.frame_timestamp, keys.sensor_timestamp)):
            lead = 1e-6 * (
                depth.get_frame_metadata(keys.frame_timestamp) - depth.get_frame_metadata(keys.sensor_timestamp)
            )
            if depth.supports_frame_metadata(keys.actual_exposure):
                lead += 0.5e-6 * depth.get_frame_metadata(keys.actual_exposure)
        return self._mapper.stamp(depth.timestamp * 1e-3, self._clock.now(), lead)

    def depth(self, shot: Shot) -> NDArray[np.uint16]:
        """Raw depth of a shot, smoothed when the config asks for it; 0 outside of the measuring range. Shape (H, W)."""
        frame = shot.frameset.get_depth_frame()
        for block in self._smoothing:
            frame = block.process(frame)
        raw = np.array(frame.get_data(), dtype=np.uint16)
        near, far = self._config.near_m / self.depth_scale, self._config.far_m / self.depth_scale
        raw[(raw < near) | (raw > far)] = 0
        return raw

    def aligned_color(self, shot: Shot) -> NDArray[np.uint8] | None:
        """Colour of the same exposure, registered to the depth image; None when there is none. Shape (H, W, 3)."""
        if self._align is None or not shot.in_step:
            return None
        return np.array(self._align.process(shot.frameset).get_color_frame().get_data(), dtype=np.uint8)

    def color(self, shot: Shot) -> NDArray[np.uint8] | None:
        """Colour of the same exposure as it was taken; None when there is none. Shape (H, W, 3)."""
        return np.array(shot.frameset.get_color_frame().get_data(), dtype=np.uint8) if shot.in_step else None

    def lost(self) -> str:
        """Why no frame can come any more, "" when one can."""
        if self._playback is not None:
            ended = self._playback.current_status() == self._rs.playback_status.stopped
            return f"{self._name()} has ended" if ended else ""
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


def _stop(pipeline: Any) -> None:
    try:
        pipeline.stop()
    except RuntimeError:
        return  # it never ran, or its device is gone: there is nothing left to stop


def _key(frameset: Any) -> tuple[int, float]:
    depth = frameset.get_depth_frame()
    return int(depth.frame_number), float(depth.timestamp)


def _last_words(error: RuntimeError) -> str:
    return str(error).strip().rstrip(".")


def _smoothing(rs: Any, config: CameraConfig) -> list[Any]:
    """librealsense's filters in their recommended order; none of them remembers earlier frames."""
    wanted = config.realsense.spatial
    if wanted is None:
        return []
    spatial = rs.spatial_filter()
    spatial.set_option(rs.option.filter_magnitude, wanted.magnitude)
    spatial.set_option(rs.option.filter_smooth_alpha, wanted.alpha)
    spatial.set_option(rs.option.filter_smooth_delta, wanted.delta)
    spatial.set_option(rs.option.holes_fill, 0)
    return [rs.disparity_transform(True), spatial, rs.disparity_transform(False)]


def _start_problem(words: str, info: CameraInfo, config: CameraConfig) -> HardwareError:
    """What a failed start means, with the next step; only what another attempt may mend is `StartFailed`."""
    what = f"camera {info.serial} does not start: {words}."
    if "busy" in words.lower():
        return HardwareError(
            f"{what} Another program has it: close realsense-viewer, a ROS camera node or another evg-app"
        )
    if "resolve" in words.lower():
        color = config.realsense.color
        wanted = f"depth {config.width_px}x{config.height_px}"
        wanted += f" and colour {color.width_px}x{color.height_px}" if color else ""
        advice = info.link_advice() or "Change the stream sizes or fps in the camera's YAML"
        return HardwareError(f"{what} It does not offer {wanted} at {config.realsense.fps} Hz. {advice}")
    return StartFailed(what)
