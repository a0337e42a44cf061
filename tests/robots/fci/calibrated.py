"""A calibration file for a camera whose place is known."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from evg_app.config.calibration import (
    FORMAT,
    Calibration,
    Errors,
    IntrinsicsModel,
    Witness,
    pose_of,
    project,
    save_calibration,
)
from evg_app.config.camera import CameraConfig
from evg_app.geometry import Array, invert, transform_points, translation

POINTS = ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.1, 0.1, 0.0), (0.05, 0.02, 0.0))


def calibrated(folder: Path, camera: CameraConfig, T_base_cam: Array, **changes: object) -> Path:
    """Writes `folder/calibration/panda-<camera>-<date>.yaml`, true to `T_base_cam` (4, 4); `changes` spoil it."""
    intrinsics = camera.simulated_intrinsics()
    T_base_hand, T_hand_board = translation(0.5, 0.0, 0.1), translation(-0.05, -0.05, 0.0)
    seen = transform_points(invert(T_base_cam) @ T_base_hand @ T_hand_board, np.array(POINTS))
    pixels = project(intrinsics, seen)
    witnesses = tuple(
        Witness(T_base_hand=pose_of(T_base_hand), board_point_m=point, pixel=(float(u), float(v)))
        for point, (u, v) in zip(POINTS, pixels, strict=True)
    )
    errors = Errors(
        heldout_mm=0.5, heldout_deg=0.1, bound_mm=1.0, bound_deg=0.2, reprojection_px=0.2, samples=20, rejected=0
    )
    good = Calibration(
        format=FORMAT,
        robot="panda",
        camera=camera.name,
        mode="eye-to-hand",
        parent_frame="panda_link0",
        camera_frame=camera.frame_id,
        T_parent_cam=pose_of(T_base_cam),
        T_other_board=pose_of(T_hand_board),
        created_utc=datetime.now(UTC),
        verdict="go",
        errors=errors,
        board="test board",
        board_sha256="0" * 64,
        intrinsics=IntrinsicsModel.of(intrinsics),
        witnesses=witnesses,
    )
    return save_calibration(good.model_copy(update=changes), folder / "calibration")
