"""Starting a librealsense pipeline on a device or a recording, and what a failed start means."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evg_app.cameras.realsense.devices import CameraInfo, choose
from evg_app.cameras.realsense.settings import apply_settings
from evg_app.config.camera import CameraConfig
from evg_app.errors import BadInput, HardwareError


@dataclass(frozen=True)
class Recording:
    """A .db3 file that stands in for the device. `real_time` False gives every frame as fast as it is asked for."""

    path: Path
    repeat: bool = False
    real_time: bool = True


class StartFailed(HardwareError):
    """The camera is there but did not start; another attempt or a reset may help."""


def start_recording(rs: Any, pipeline: Any, recording: Recording) -> Any:
    """Play a file. Returns the pipeline's profile.

    Raises:
        BadInput: it cannot be played.
    """
    setup = rs.config()
    try:
        setup.enable_device_from_file(str(recording.path), recording.repeat)
        resolved = setup.resolve(rs.pipeline_wrapper(pipeline))
        resolved.get_device().as_playback().set_real_time(recording.real_time)  # before the first frame is read
        return pipeline.start(setup)
    except RuntimeError as error:
        raise BadInput(
            f"recording {recording.path} cannot be played: {last_words(error)}. "
            "Name a .db3 file made by: evg-app camera record"
        ) from error


def start_device(
    rs: Any, pipeline: Any, config: CameraConfig, serial: str, record_to: Path | None
) -> tuple[Any, Mapping[str, float]]:
    """Set the device up and start its streams. Returns the pipeline's profile and the settings read back.

    Raises:
        StartFailed: the device is there and did not start.
        HardwareError: no such device, streams not offered, or somebody else has it.
        BadInput: the device refuses a setting, or several are connected and none was named.
    """
    info, wanted = choose(rs, serial), config.realsense
    setup = rs.config()
    setup.enable_device(info.serial)
    setup.enable_stream(rs.stream.depth, config.width_px, config.height_px, rs.format.z16, wanted.fps)
    if wanted.color is not None:
        setup.enable_stream(rs.stream.color, wanted.color.width_px, wanted.color.height_px, rs.format.rgb8, wanted.fps)
    if record_to is not None:
        setup.enable_record_to_file(str(record_to))
    try:
        resolved = setup.resolve(rs.pipeline_wrapper(pipeline))
        settings = apply_settings(rs, resolved.get_device().first_depth_sensor(), wanted)
        return pipeline.start(setup), settings
    except RuntimeError as error:
        raise _problem(last_words(error), info, config) from error


def last_words(error: RuntimeError) -> str:
    """librealsense's message as part of a sentence."""
    return str(error).strip().rstrip(".")


def _problem(words: str, info: CameraInfo, config: CameraConfig) -> HardwareError:
    """What a failed start means, with the next step; only what another attempt may mend is `StartFailed`."""
    what = f"camera {info.serial} does not start: {words}."
    if "busy" in words.lower():
        return HardwareError(
            f"{what} Another program has it: close realsense-viewer, a ROS camera node or another evg-app"
        )
    if "resolve" in words.lower():
        color = config.realsense.color
        asked = f"depth {config.width_px}x{config.height_px}"
        asked += f" and colour {color.width_px}x{color.height_px}" if color else ""
        advice = info.link_advice() or "Change the stream sizes or fps in the camera's YAML"
        return HardwareError(f"{what} It does not offer {asked} at {config.realsense.fps} Hz. {advice}")
    return StartFailed(what)
