"""The one place that makes a camera: `open_camera`, and `open_replay` for stored frames."""

from pathlib import Path

from evg_app.cameras.realsense.camera import RealSenseCamera
from evg_app.cameras.replay import ReplayCamera, attempt_frames, recorded_frames
from evg_app.clock import Clock, WallClock
from evg_app.config.camera import CameraConfig
from evg_app.events import Sink, Warned


def open_camera(
    config: CameraConfig,
    *,
    clock: Clock | None = None,
    sink: Sink | None = None,
    serial: str = "",
    record_to: Path | None = None,
) -> RealSenseCamera:
    """The camera of a config, not yet entered: `with open_camera(load_camera("d435i"), sink=sink) as camera:`.

    Nothing is imported from librealsense and nothing is opened before `__enter__`, which starts the streams, warms
    them up, and raises when no frame comes.

    What it gives beyond `Camera.capture(after=, timeout=) -> Frame` (depth in the DEPTH optical frame
    `camera.frame_id`, colour registered to it): `camera.capture_color(after=, timeout=) -> ColorImage` for a
    calibration board, and `camera.T_color_depth` (4, 4), so that a camera pose found with colour becomes the pose of
    the depth frame: `T_base_depth = T_base_color @ camera.T_color_depth`. `camera.info`, `camera.settings` and
    `camera.dropped` are for the log.

    Args:
        config: from `evg_app.config.files.load_camera`.
        clock: of stamps and waits; the wall clock when None. Use the same one for the arm and the loop.
        sink: gets a `Warned` event for each retry, restart and hardware reset.
        serial: which of several cameras; "" takes the config's, and if that is empty the only one.
        record_to: also write the streams to this .db3 file.

    Raises (on entering):
        MissingExtra: pyrealsense2 is not installed.
        HardwareError: no camera, no permission, somebody else has it, or no frame in all attempts.
        BadInput: a setting that this camera does not take.
    """

    def report(cause: str, text: str) -> None:
        """Pass what the camera goes through on to the sink."""
        if sink is not None:
            sink(Warned(cause, text))

    return RealSenseCamera(config, clock or WallClock(), report, serial, record_to=record_to)


def open_replay(
    config: CameraConfig, source: Path, *, clock: Clock | None = None, repeat: bool = False
) -> ReplayCamera:
    """A camera that hands out stored frames one by one, not yet entered.

    Args:
        config: whose `frame_id` and measuring range are used; the optics are the stored ones.
        source: a .db3 recording, or the folder of a run.
        clock: of the stamps; the wall clock when None.
        repeat: begin again at the end instead of raising `HardwareError`.

    Raises:
        BadInput: it is neither.
        MissingExtra (on entering): pyrealsense2 is not installed and the source is a .db3 file.
    """
    clock = clock or WallClock()
    frames = recorded_frames(source, config, clock) if source.suffix == ".db3" else attempt_frames(source)
    return ReplayCamera(str(source), frames, config.frame_id, clock, repeat)
