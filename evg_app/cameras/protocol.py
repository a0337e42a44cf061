"""What the loop needs of a depth camera, and what a calibration needs on top."""

from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import Array
from evg_app.types import Frame, Intrinsics


class Camera(Protocol):
    """A depth camera; a context manager whose exit may be called twice and after a failed entry."""

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the depth stream, from the device, not from a file."""

    @property
    def frame_id(self) -> str:
        """Name of the depth optical frame."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def capture(self, *, after: float, timeout: float) -> Frame:
        """The first frame exposed at or after `after` [s, `Clock.now`], waiting at most `timeout` [s].

        Raises:
            DeviceTimeout: no such frame arrived.
            HardwareError: the device failed.
        """


@dataclass(frozen=True)
class ColorImage:
    """One picture of the colour camera as it was taken: not aligned to depth, not undistorted.

    Attributes:
        color: uint8 RGB, shape (H, W, 3).
        intrinsics: of the colour stream, with its distortion.
        stamp: when it was exposed [s, `Clock.now`].
        frame_id: name of the colour optical frame.
        number: counts the pictures.
    """

    color: NDArray[np.uint8]
    intrinsics: Intrinsics
    stamp: float
    frame_id: str
    number: int = 0


class ColorCamera(Camera, Protocol):
    """A depth camera whose colour camera can be used by itself, for example to find a calibration board.

    A pose of the colour frame becomes one of the depth frame by `T_x_depth = T_x_color @ camera.T_color_depth`.
    """

    @property
    def T_color_depth(self) -> Array:
        """Depth optical frame to colour optical frame, from the device. Shape (4, 4)."""

    def capture_color(self, *, after: float, timeout: float) -> ColorImage:
        """The first picture exposed at or after `after` [s], waiting at most `timeout` [s]; raises as `capture`."""
