"""`ReplayCamera`: stored frames behind the `Camera` protocol, from a .db3 recording or from the attempts of a run."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from evg_app.cameras.realsense.camera import RealSenseCamera
from evg_app.cameras.realsense.start import Recording
from evg_app.clock import Clock
from evg_app.config.camera import CameraConfig
from evg_app.errors import BadInput, DeviceTimeout, HardwareError
from evg_app.types import Frame, Intrinsics

ATTEMPTS = "attempts"
"""Folder of a run that holds one .npz per attempt."""
READING = 30.0
"""How long the next frame of a recording may take to be read [s]."""

Frames = Callable[[], Iterator[Frame]]
"""Starts reading the stored frames from the beginning; their stamps and numbers do not matter."""


class ReplayCamera:
    """A `Camera` that hands out stored frames one by one, each as if it had been exposed when it was asked for.

    Args:
        name: of the source, for messages.
        frames: reads it.
        frame_id: name of the depth optical frame.
        clock: of the stamps; waits until `after` on it.
        repeat: begin again at the end instead of failing.
    """

    def __init__(self, name: str, frames: Frames, frame_id: str, clock: Clock, repeat: bool = False) -> None:
        self._name, self._frames, self._frame_id, self._clock, self._repeat = name, frames, frame_id, clock, repeat
        self._source: Iterator[Frame] | None = None
        self._ahead: Frame | None = None
        self._intrinsics: Intrinsics | None = None
        self._count = 0

    def __enter__(self) -> Self:
        self._source = self._frames()
        self._ahead = next(self._source, None)
        if self._ahead is None:
            raise BadInput(f"{self._name} holds no depth frame. Name a .db3 recording or the folder of a run")
        self._intrinsics = self._ahead.intrinsics
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        source, self._source, self._ahead = self._source, None, None
        if source is not None and hasattr(source, "close"):
            source.close()

    @property
    def identity(self) -> dict[str, str]:
        """Where the frames come from."""
        return {"driver": "replay", "source": self._name}

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the depth stream, as it was stored."""
        if self._intrinsics is None:
            raise HardwareError(f"{self._name} is not open: use the camera in a `with` block")
        return self._intrinsics

    @property
    def frame_id(self) -> str:
        """Name of the depth optical frame."""
        return self._frame_id

    def capture(self, *, after: float, timeout: float) -> Frame:
        """The next stored frame, stamped now, or `after` [s] if that is later.

        Raises:
            DeviceTimeout: `after` is more than `timeout` [s] away.
            HardwareError: there is no further frame.
        """
        wait = after - self._clock.now()
        if wait > timeout:
            raise DeviceTimeout(f"a frame of {self._name}", timeout, "It was asked for a time too far ahead.")
        frame = self._next()
        while (wait := after - self._clock.now()) > 0:
            self._clock.sleep(wait)
        self._count += 1
        return replace(frame, stamp=self._clock.now(), frame_id=self._frame_id, number=self._count)

    def _next(self) -> Frame:
        """The next stored frame, from the beginning again when asked to repeat."""
        if self._source is None:
            raise HardwareError(f"{self._name} is not open: use the camera in a `with` block")
        frame, self._ahead = self._ahead or next(self._source, None), None
        if frame is None and self._repeat:
            self._source = self._frames()
            frame = next(self._source, None)
        if frame is None:
            raise HardwareError(f"{self._name} has ended after {self._count} frames. Name a longer one")
        return frame


def attempt_frames(folder: Path) -> Frames:
    """The depth images of a run's attempts, oldest first: the run's folder, or its `attempts/`.

    Raises:
        BadInput: no such folder; later, from reading, a file that is not an attempt.
    """
    inside = folder / ATTEMPTS if (folder / ATTEMPTS).is_dir() else folder
    if not inside.is_dir():
        raise BadInput(f"{folder} is neither a .db3 recording nor a folder. Name one of them")

    def read() -> Iterator[Frame]:
        """Frame by frame."""
        for path in sorted(inside.glob("*.npz"), key=lambda p: (p.stat().st_mtime_ns, p.name)):
            frame = _attempt_frame(path)
            if frame is not None:
                yield frame

    return read


def _attempt_frame(path: Path) -> Frame | None:
    """The frame of one attempt, None when it never took one."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays: dict[str, np.ndarray[Any, Any]] = {
                name: stored[name]
                for name in ("depth", "depth_scale", "image_size", "focal_centre", "distortion", "color")
                if name in stored
            }
    except (OSError, ValueError) as error:
        raise BadInput(f"{path} is not an attempt of a run: {error}") from error
    if "depth" not in arrays:
        return None
    (width, height), (fx, fy, cx, cy) = (int(n) for n in arrays["image_size"]), arrays["focal_centre"].tolist()
    intrinsics = Intrinsics(width, height, fx, fy, cx, cy, tuple(arrays["distortion"].tolist()))
    color = arrays.get("color")
    return Frame(arrays["depth"], float(arrays["depth_scale"]), intrinsics, 0.0, "", color)


def recorded_frames(path: Path, config: CameraConfig, clock: Clock, sdk: Any = None) -> Frames:
    """Every frame of a .db3 recording, as fast as it is asked for, through librealsense's own pipeline.

    The pipeline begins when each stream has given an image, which may cost the first frame.
    """
    asked = config.realsense.model_copy(update={"average_frames": 1, "stall_s": READING})
    config = config.model_copy(update={"realsense": asked})

    def read() -> Iterator[Frame]:
        """Frame by frame."""
        source = Recording(path, real_time=False)
        with RealSenseCamera(config, clock, recording=source, sdk=sdk) as camera:
            while True:
                try:
                    yield camera.capture(after=float("-inf"), timeout=READING)
                except DeviceTimeout:
                    raise
                except HardwareError:
                    return  # the recording has ended

    return read
