"""Model of a camera's YAML file: what is asked of the device, what is done to its depth, and when it is too bad."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from evg_app.config.base import Model, Positive
from evg_app.types import Intrinsics

Share = Annotated[float, Field(ge=0, le=1)]
Preset = Literal["default", "hand", "high accuracy", "high density", "medium density"]


class SpatialFilter(Model):
    """librealsense's edge-preserving filter; it smooths within a surface and fills no holes."""

    magnitude: int = Field(default=2, ge=1, le=5)
    alpha: Annotated[float, Field(ge=0.25, le=1)] = 0.5
    delta: int = Field(default=8, ge=1, le=50)


class ColorStream(Model):
    """The colour stream, aligned to depth for a `Frame` and left alone for calibration."""

    width_px: int = Field(default=1280, gt=0)
    height_px: int = Field(default=720, gt=0)
    frame_id: str = "camera_color_optical_frame"


class RealSenseModel(Model):
    """What is asked of a RealSense. A value that is None is left as the device has it.

    Attributes:
        serial: which of several cameras; empty takes the only one.
        fps: frame rate of both streams [1/s].
        color: the colour stream, or None for depth alone.
        preset: visual preset of the depth sensor, set before everything else.
        exposure_us: exposure of the depth sensor [us]; None is automatic.
        gain: of the depth sensor; only with `exposure_us`.
        laser_power_mw: of the projector [mW]; 0 switches it off.
        depth_unit_m: metres per unit of raw depth that the device is told to use [m].
        spatial: edge-preserving smoothing, or None.
        average_frames: fresh frames that are merged into one depth image.
        warmup_s: how long automatic exposure may settle after a start [s].
        stall_s: without any frame for this long, the stream counts as dead [s].
        attempts: starts in all before the camera is given up; the last one follows a hardware reset.
        reset_timeout_s: how long the camera may be gone after a hardware reset [s].
    """

    serial: str = ""
    fps: int = Field(default=30, gt=0, le=90)
    color: ColorStream | None = ColorStream()
    preset: Preset = "default"
    exposure_us: Positive | None = None
    gain: Positive | None = None
    laser_power_mw: Annotated[float, Field(ge=0)] | None = None
    depth_unit_m: Positive | None = None
    spatial: SpatialFilter | None = None
    average_frames: int = Field(default=1, ge=1, le=60)
    warmup_s: Annotated[float, Field(ge=0, le=30)] = 1.0
    stall_s: Annotated[float, Field(gt=0, le=10)] = 1.0
    attempts: int = Field(default=3, ge=1, le=10)
    reset_timeout_s: Positive = 10.0

    @model_validator(mode="after")
    def _manual(self) -> Self:
        if self.gain is not None and self.exposure_us is None:
            raise ValueError("gain is automatic while exposure_us is; set exposure_us too")
        return self


class Recheck(Model):
    """The look just before the approach: is the scene near the grasp still the one planned on?

    Attributes:
        enabled: whether it is taken.
        radius_m: how far around the grasp [m].
        depth_m: depth must change by more than this [m]: more than the noise between two frames.
        area_m2: so much surface must have come or gone [m^2].
    """

    enabled: bool = True
    radius_m: Positive = 0.12
    depth_m: Positive = 0.02
    area_m2: Positive = 4e-4


class CameraConfig(Model):
    """One depth camera (`robot_configs/<name>.yaml`). Intrinsics come from the stream; these are the simulated ones.

    Attributes:
        near_m, far_m: depth outside of this is no measurement [m].
        frame_timeout_s: how long the loop waits for one frame [s].
        min_valid_ratio: least share of the workspace's pixels with depth.
        max_table_noise_m: largest noise of depth on the table before a run [m].
        max_table_bias_ratio: largest relative error of the table's distance before a run.
        max_table_tilt_deg: largest angle between the seen and the known table before a run [deg].
        table_is_ruler: multiply depth by the factor that brings the seen table to its known height.
        recheck: the look just before the approach.
    """

    device: Literal["camera"]
    name: str
    driver: Literal["realsense"]
    description: str
    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    simulated_fx_px: Positive
    simulated_fy_px: Positive
    simulated_cx_px: Positive
    simulated_cy_px: Positive
    depth_scale_m: Positive = 0.001
    near_m: Positive = 0.1
    far_m: Positive = 2.0
    frame_id: str
    frame_timeout_s: Positive = 5.0
    calibration_max_age_days: Positive = 30.0
    min_valid_ratio: Share = 0.3
    max_table_noise_m: Positive = 0.005
    max_table_bias_ratio: Positive = 0.04
    max_table_tilt_deg: Positive = 2.0
    table_is_ruler: bool = True
    recheck: Recheck = Recheck()
    realsense: RealSenseModel = RealSenseModel()

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.near_m >= self.far_m:
            raise ValueError(f"near_m {self.near_m} must be below far_m {self.far_m}")
        return self

    def simulated_intrinsics(self) -> Intrinsics:
        """Pinhole model of the simulated depth stream."""
        return Intrinsics(
            self.width_px,
            self.height_px,
            self.simulated_fx_px,
            self.simulated_fy_px,
            self.simulated_cx_px,
            self.simulated_cy_px,
        )
