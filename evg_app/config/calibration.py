"""The result of a hand-eye calibration as a file: `calibration/<robot>-<camera>-<date>.yaml`, and who may use it.

`load_calibration` refuses a missing, refused, edited, inverted or stale result with the command that mends it.
"""

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
import yaml
from pydantic import Field, model_validator

from evg_app.config.files import read, search_path
from evg_app.config.models import CameraConfig, Model, Pose, RobotConfig
from evg_app.errors import Refused
from evg_app.geometry import Array, invert, to_quaternion, transform_points
from evg_app.types import Intrinsics

FOLDER = "calibration"
FORMAT: Literal["evg-app hand-eye 1"] = "evg-app hand-eye 1"
WITNESS_TOLERANCE_PX = 8.0
"""Largest RMS error of the stored samples under the stored transform; good results have well below 1."""

Positive = Annotated[float, Field(gt=0)]
Mode = Literal["eye-to-hand", "eye-in-hand"]
MODES: tuple[Mode, ...] = ("eye-to-hand", "eye-in-hand")
Verdict = Literal["go", "warn", "refuse"]


class IntrinsicsModel(Model):
    """The stream that the board was seen in."""

    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    fx_px: Positive
    fy_px: Positive
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...] = ()

    @staticmethod
    def of(value: Intrinsics) -> "IntrinsicsModel":
        """From the value."""
        return IntrinsicsModel(
            width_px=value.width,
            height_px=value.height,
            fx_px=value.fx,
            fy_px=value.fy,
            cx_px=value.cx,
            cy_px=value.cy,
            distortion=value.distortion,
        )

    def value(self) -> Intrinsics:
        """As a value."""
        return Intrinsics(
            self.width_px, self.height_px, self.fx_px, self.fy_px, self.cx_px, self.cy_px, self.distortion
        )


class Witness(Model):
    """One sample kept in the file: where the hand was, and the pixel at which a point of the board was seen."""

    T_base_hand: Pose
    board_point_m: tuple[float, float, float]
    pixel: tuple[float, float]


class Errors(Model):
    """How good the result is.

    Attributes:
        heldout_mm, heldout_deg: RMS error on samples that were not fitted (leave-k-out).
        bound_mm, bound_deg: 95 % upper bound of the error over the workspace cube.
        reprojection_px: RMS residual of the fit.
        samples, rejected: samples used, and samples taken but left out.
    """

    heldout_mm: Annotated[float, Field(ge=0)]
    heldout_deg: Annotated[float, Field(ge=0)]
    bound_mm: Annotated[float, Field(ge=0)]
    bound_deg: Annotated[float, Field(ge=0)]
    reprojection_px: Annotated[float, Field(ge=0)]
    samples: int = Field(ge=0)
    rejected: int = Field(ge=0)


class Calibration(Model):
    """One result. `T_parent_cam` maps camera coordinates to `parent_frame`: the base, or the hand (eye-in-hand).

    Attributes:
        T_picture_cam: the camera frame in the frame of the pictures (colour) that the board was found in.
        T_other_board: the board in the hand (eye-to-hand) or in the base (eye-in-hand).
        board_scale: true size of the board over its nominal size.
        forced: the user let a refused result through with `--force`.
        run: folder of the samples, from which `evg-app calibrate --from` solves again.
    """

    format: Literal["evg-app hand-eye 1"]
    robot: str
    camera: str
    mode: Mode
    parent_frame: str
    camera_frame: str
    T_parent_cam: Pose
    T_other_board: Pose
    T_picture_cam: Pose = Pose(xyz_m=(0.0, 0.0, 0.0))
    created_utc: datetime
    verdict: Verdict
    forced: bool = False
    reasons: tuple[str, ...] = ()
    errors: Errors
    board: str
    board_sha256: str
    board_scale: Positive = 1.0
    intrinsics: IntrinsicsModel
    witnesses: tuple[Witness, ...] = Field(min_length=4)
    run: str = ""
    version: str = ""
    commit: str = ""

    @model_validator(mode="after")
    def _has_zone(self) -> Self:
        """A date without a zone could be half a day off."""
        if self.created_utc.tzinfo is None:
            raise ValueError("created_utc needs a time zone, for example 2026-01-31T12:00:00Z")
        return self

    def T_base_cam(self, T_base_hand: Array) -> Array:
        """The camera in the base frame when the hand is at `T_base_hand` (4, 4). Shape (4, 4)."""
        T = self.T_parent_cam.matrix()
        return T if self.mode == "eye-to-hand" else T_base_hand @ T

    def witness_error(self, T_parent_cam: Array | None = None) -> float:
        """RMS distance [px] of the witnesses from where a transform (default: this one) puts them; inf if behind."""
        T = self.T_parent_cam.matrix() if T_parent_cam is None else T_parent_cam
        T_other_board, intrinsics = self.T_other_board.matrix(), self.intrinsics.value()
        squares = []
        for witness in self.witnesses:
            hand = witness.T_base_hand.matrix()
            point = transform_points(T_other_board, np.array(witness.board_point_m) * self.board_scale)
            in_base = transform_points(hand, point) if self.mode == "eye-to-hand" else point
            in_parent = in_base if self.mode == "eye-to-hand" else transform_points(invert(hand), in_base)
            p = transform_points(self.T_picture_cam.matrix() @ invert(T), in_parent)
            if p[2] <= 0:
                return float("inf")
            squares.append(float(((project(intrinsics, p) - np.array(witness.pixel)) ** 2).sum()))
        return float(np.sqrt(np.mean(squares)))


def pose_of(T: Array) -> Pose:
    """A transform (4, 4) as it stands in files."""
    x, y, z = (round(float(v), 9) for v in T[:3, 3])
    qx, qy, qz, qw = (round(float(v), 12) for v in to_quaternion(T))
    return Pose(xyz_m=(x, y, z), quaternion_xyzw=(qx, qy, qz, qw))


def project(intrinsics: Intrinsics, points: Array) -> Array:
    """Pixels (column, row) of camera points (..., 3) in front of the camera, with distortion. Shape (..., 2)."""
    x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
    k1, k2, p1, p2, k3 = (*intrinsics.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    pixels: Array = np.stack([u * intrinsics.fx + intrinsics.cx, v * intrinsics.fy + intrinsics.cy], axis=-1)
    return pixels


def save_calibration(result: Calibration, folder: Path) -> Path:
    """Write `<robot>-<camera>-<date>.yaml` into a folder, never over an older file. Returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"{result.robot}-{result.camera}-{result.created_utc.astimezone(UTC):%Y-%m-%dT%H%M%SZ}"
    path = folder / f"{stem}.yaml"
    number = 1
    while path.exists():
        number += 1
        path = folder / f"{stem}-{number}.yaml"
    write_calibration(result, path)
    return path


def write_calibration(result: Calibration, path: Path) -> None:
    """Write one result as YAML."""
    text = yaml.safe_dump(result.model_dump(mode="json"), sort_keys=False, width=120)
    path.write_text(text, encoding="utf-8")


def newest_calibration(robot: str, camera: str, config_dir: Path | None = None) -> tuple[Calibration, Path]:
    """The newest result for a pair of devices in the first folder of the search path that has one.

    Raises:
        Refused: there is none.
        ConfigError: a file is broken.
    """
    folders = list(dict.fromkeys(folder / FOLDER for folder in search_path(config_dir)))
    for folder in folders:
        found = [(read(path, Calibration), path) for path in sorted(folder.glob(f"{robot}-{camera}-*.yaml"))]
        if found:
            return max(found, key=lambda pair: pair[0].created_utc)
    raise Refused(
        f"no calibration of '{camera}' with '{robot}' in {', '.join(str(f) for f in folders)}. "
        f"Run: {calibrate_command(robot, camera)}"
    )


def calibrate_command(robot: str, camera: str, mode: str = "eye-to-hand") -> str:
    """The command that makes a new result."""
    return f"evg-app calibrate --robot {robot} --camera {camera} --mode {mode}"


def load_calibration(
    robot: RobotConfig, camera: CameraConfig, config_dir: Path | None = None, now: datetime | None = None
) -> Calibration:
    """The newest result for these devices, if `run` may use it.

    Args:
        robot: whose base or hand the camera is known in.
        camera: its `calibration_max_age_days` is the age limit.
        config_dir: the user's folder, searched first.
        now: time for the age check (default: now).

    Raises:
        Refused: missing, refused, stale, inverted, edited, or for another camera frame; says the command to run.
        ConfigError: a file is broken.
    """
    result, path = newest_calibration(robot.name, camera.name, config_dir)
    problem = problem_of(result, robot, camera, now or datetime.now(UTC))
    if problem:
        raise Refused(f"{path}: {problem}. Run: {calibrate_command(robot.name, camera.name, result.mode)}")
    return result


def problem_of(result: Calibration, robot: RobotConfig, camera: CameraConfig, now: datetime) -> str:
    """Why a result must not be used, or an empty string."""
    if result.verdict == "refuse" and not result.forced:
        return f"this calibration was refused ({'; '.join(result.reasons) or 'no reason given'})"
    age = (now - result.created_utc).total_seconds() / 86400
    if age > camera.calibration_max_age_days:
        limit = f"{camera.calibration_max_age_days:g} days (calibration_max_age_days)"
        return f"this calibration is {age:.0f} days old, allowed are {limit}"
    if age < -1:
        return f"this calibration is dated {-age:.0f} days in the future; check the clock"
    frame = robot.hand_link if result.mode == "eye-in-hand" else None
    if frame is not None and result.parent_frame != frame:
        return f"it is for the frame '{result.parent_frame}', the robot's hand is '{frame}'"
    if result.camera_frame != camera.frame_id:
        return f"it is for the camera frame '{result.camera_frame}', the camera's frame_id is '{camera.frame_id}'"
    if result.witness_error() > WITNESS_TOLERANCE_PX:
        if result.witness_error(invert(result.T_parent_cam.matrix())) <= WITNESS_TOLERANCE_PX:
            return "T_parent_cam is inverted: it holds the parent in the camera's frame"
        return "T_parent_cam does not fit the samples stored beside it: was it edited?"
    return _looks_away(result, robot)


def _looks_away(result: Calibration, robot: RobotConfig) -> str:
    """A camera that stands still must have the middle of the workspace in front of it."""
    if result.mode == "eye-in-hand":
        return ""
    middle = transform_points(robot.T_base_task.matrix(), np.full(3, 0.15))
    depth = float(transform_points(invert(result.T_parent_cam.matrix()), middle)[2])
    if depth <= 0:
        return "the camera looks away from the workspace: it was moved, or the transform is inverted"
    return ""
