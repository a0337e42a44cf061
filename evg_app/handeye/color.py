"""The colour camera as the camera of a calibration: sharper pictures than colour registered to depth."""

from types import TracebackType
from typing import Self

import numpy as np

from evg_app.cameras.protocol import ColorCamera
from evg_app.types import Frame, Intrinsics


class ColorPictures:
    """A `Camera` whose frames are raw colour pictures without depth. Entered and left with the camera it wraps."""

    def __init__(self, camera: ColorCamera) -> None:
        """Wrap a camera that is not entered yet."""
        self._camera = camera
        self._intrinsics: Intrinsics | None = None

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the colour stream; known from the first picture on."""
        if self._intrinsics is None:
            self._intrinsics = self._camera.capture_color(after=0.0, timeout=5.0).intrinsics
        return self._intrinsics

    @property
    def frame_id(self) -> str:
        """Name of the depth optical frame, which the result is for."""
        return self._camera.frame_id

    def __enter__(self) -> Self:
        """Enter the camera."""
        self._camera.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the camera."""
        self._camera.__exit__(kind, error, trace)

    def capture(self, *, after: float, timeout: float) -> Frame:
        """The first colour picture exposed at or after `after` [s]; depth is 0 everywhere."""
        shot = self._camera.capture_color(after=after, timeout=timeout)
        self._intrinsics = shot.intrinsics
        nothing = np.zeros(shot.color.shape[:2], np.uint16)
        return Frame(nothing, 0.001, shot.intrinsics, shot.stamp, shot.frame_id, shot.color, shot.number)
