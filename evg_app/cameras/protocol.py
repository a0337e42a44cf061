"""What the loop needs of a depth camera."""

from types import TracebackType
from typing import Protocol, Self

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
