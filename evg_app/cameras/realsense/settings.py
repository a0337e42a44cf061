"""Preset, exposure, laser and depth unit as the camera config asks, and what the device then really has."""

from collections.abc import Mapping
from typing import Any

from evg_app.config.camera import RealSenseModel
from evg_app.errors import BadInput


def apply_settings(rs: Any, sensor: Any, wanted: RealSenseModel) -> Mapping[str, float]:
    """Set the depth sensor up, the preset first because it resets the rest. Call before the stream starts.

    Returns:
        What the device has afterwards, read back, by the config's key. A missing key was left alone.

    Raises:
        BadInput: the device lacks the option or the value is outside its range.
    """
    option = rs.option
    preset = getattr(rs.rs400_visual_preset, wanted.preset.replace(" ", "_"))
    have: dict[str, float] = {}
    if wanted.preset != "default" or sensor.supports(option.visual_preset):
        have["preset"] = _set(sensor, option.visual_preset, float(int(preset)), "preset")
    if wanted.depth_unit_m is not None:
        have["depth_unit_m"] = _set(sensor, option.depth_units, wanted.depth_unit_m, "depth_unit_m")
    if wanted.exposure_us is None:
        if sensor.supports(option.enable_auto_exposure):
            have["automatic_exposure"] = _set(sensor, option.enable_auto_exposure, 1.0, "exposure_us")
    else:
        have["automatic_exposure"] = _set(sensor, option.enable_auto_exposure, 0.0, "exposure_us")
        have["exposure_us"] = _set(sensor, option.exposure, wanted.exposure_us, "exposure_us")
        if wanted.gain is not None:
            have["gain"] = _set(sensor, option.gain, wanted.gain, "gain")
    if wanted.laser_power_mw is not None:
        on = float(wanted.laser_power_mw > 0)
        have["emitter"] = _set(sensor, option.emitter_enabled, on, "laser_power_mw")
        if on:
            have["laser_power_mw"] = _set(sensor, option.laser_power, wanted.laser_power_mw, "laser_power_mw")
    if sensor.supports(option.global_time_enabled):
        have["global_time"] = _set(sensor, option.global_time_enabled, 1.0, "global_time")
    return have


def _set(sensor: Any, option: Any, value: float, key: str) -> float:
    """Set one option and read it back."""
    if not sensor.supports(option):
        raise BadInput(f"realsense.{key}: this camera has no option '{option.name}'. Remove the key from its YAML")
    bounds = sensor.get_option_range(option)
    if not bounds.min <= value <= bounds.max:
        raise BadInput(
            f"realsense.{key}: {value:g} is outside of {bounds.min:g} to {bounds.max:g} "
            f"(steps of {bounds.step:g}) of this camera. Change the camera's YAML"
        )
    sensor.set_option(option, value)
    return float(sensor.get_option(option))
