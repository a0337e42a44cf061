"""`RealSenseCamera`: fresh, merged depth frames of a RealSense, and its colour camera by itself."""

from pathlib import Path
from types import TracebackType
from typing import Any, Self

from evg_app.cameras.merge import DepthMerger
from evg_app.cameras.protocol import ColorImage
from evg_app.cameras.realsense.connection import Connection, Report
from evg_app.cameras.realsense.devices import CameraInfo
from evg_app.cameras.realsense.start import Recording
from evg_app.clock import Clock
from evg_app.config.camera import CameraConfig
from evg_app.errors import BadInput, DeviceTimeout, HardwareError
from evg_app.geometry import Array
from evg_app.identity import installed
from evg_app.types import Frame, Intrinsics


def silent(cause: str, text: str) -> None:
    """A report that nobody hears."""


class RealSenseCamera:
    """A `ColorCamera` on librealsense: a device, or a .db3 recording that is played through the same pipeline.

    The arguments are those of `Connection`; `evg_app.cameras.factory.open_camera` fills them in.
    """

    def __init__(
        self,
        config: CameraConfig,
        clock: Clock,
        report: Report = silent,
        serial: str = "",
        recording: Recording | None = None,
        record_to: Path | None = None,
        sdk: Any = None,
    ) -> None:
        self._config, self._clock = config, clock
        self._connection = Connection(config, clock, report, serial, recording, record_to, sdk)
        self._count, self._entered = 0, False

    def __enter__(self) -> Self:
        self._connection.open()
        self._entered = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._entered = False
        self._connection.close()

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the depth stream, from the device."""
        return self._connection.link.streams.depth

    @property
    def frame_id(self) -> str:
        """Name of the depth optical frame."""
        return self._config.frame_id

    @property
    def T_color_depth(self) -> Array:
        """Depth optical frame to colour optical frame, from the device. Shape (4, 4).

        Raises:
            BadInput: there is no colour stream.
        """
        transform = self._connection.link.streams.T_color_depth
        if transform is None:
            raise BadInput(f"camera '{self._config.name}' has no colour stream: set realsense.color in its YAML")
        return transform

    @property
    def info(self) -> CameraInfo:
        """Serial number, firmware and USB link."""
        return self._connection.link.info

    @property
    def identity(self) -> dict[str, str]:
        """Model, serial number, firmware, link and library, and what its depth sensor was set to."""
        info = self.info
        told = {"driver": "realsense", "name": info.name, "serial": info.serial, "firmware": info.firmware}
        told |= {"firmware wanted": info.recommended, "usb": info.usb, "pyrealsense2": installed("pyrealsense2")}
        return told | {name: f"{value:g}" for name, value in self.settings.items()}

    @property
    def settings(self) -> dict[str, float]:
        """What the depth sensor was really set to, read back from it; empty for a recording."""
        return dict(self._connection.link.settings)

    @property
    def dropped(self) -> int:
        """Depth frames since the last start that the device counted and that never arrived."""
        return self._connection.link.dropped

    def capture(self, *, after: float, timeout: float) -> Frame:
        """`average_frames` frames exposed at or after `after` [s], merged; the stamp is the first one's.

        Waits at most `timeout` [s], and one restart of the stream longer when it died meanwhile.

        Raises:
            DeviceTimeout: no such frame arrived.
            HardwareError: the camera left USB, the recording has ended, or the stream cannot be started.
        """
        self._require_entered()
        deadline = self._clock.now() + timeout
        first = shot = self._connection.fresh(after, deadline, timeout)
        link, shots = self._connection.link, self._config.realsense.average_frames
        depth, scale = link.depth(shot), link.streams.depth_scale
        if shots > 1:
            merger = DepthMerger()
            merger.add(depth)
            for _ in range(shots - 1):
                shot = self._connection.fresh(shot.stamp, deadline, timeout)
                if self._connection.link is not link:
                    raise DeviceTimeout(f"{shots} frames in a row", timeout, "The stream had to be started again.")
                merger.add(link.depth(shot))
            depth, scale = merger.result(scale)
        self._count += 1
        color = link.aligned_color(shot)
        return Frame(depth, scale, link.streams.depth, first.stamp, self.frame_id, color, self._count)

    def capture_color(self, *, after: float, timeout: float) -> ColorImage:
        """The first colour image exposed at or after `after` [s], as it was taken; waits and raises as `capture`.

        Raises:
            BadInput: there is no colour stream.
        """
        self._require_entered()
        deadline = self._clock.now() + timeout
        while True:
            shot = self._connection.fresh(after, deadline, timeout)
            link, stream = self._connection.link, self._config.realsense.color
            if link.streams.color is None or stream is None:
                raise BadInput(f"camera '{self._config.name}' has no colour stream: set realsense.color in its YAML")
            color = link.color(shot)
            if color is not None:
                self._count += 1
                return ColorImage(color, link.streams.color, shot.stamp, stream.frame_id, self._count)

    def _require_entered(self) -> None:
        """Pass inside a `with` block."""
        if not self._entered:
            raise HardwareError(f"camera '{self._config.name}' is not open: use it in a `with` block")
