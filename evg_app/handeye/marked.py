"""Where the table is, from pictures of a board that lies on it: no touching, no arm for a camera that stands still."""

from collections.abc import Sequence

import numpy as np

from evg_app.config.calibration import Calibration
from evg_app.errors import Refused
from evg_app.geometry import Array, invert, transform_points
from evg_app.handeye.boards import Board
from evg_app.handeye.detect import Detection
from evg_app.perception.touched import Means, TouchedTable, touched_table

LEAST_PICTURES = 3
"""Fewer pictures in which the board was found leave nothing to judge by."""
BOARD = Means(
    point="corner of the board",
    min_span=0.10,
    max_tilt_deg=1.5,
    max_residual=0.003,
    advice="Lay the board flat in the middle of the square, keep camera and board still, and measure again. "
    "Stays it so, the camera was moved: evg-app calibrate verify",
)
"""A board's limits; its tilt also carries the calibration's error of angle."""


def picture_pose(calibration: Calibration, T_base_hand: Array) -> Array:
    """Pose in the base (4, 4) of the camera whose pictures show the board (colour), by a calibration of depth."""
    return calibration.T_base_cam(T_base_hand) @ invert(calibration.T_picture_cam.matrix())


def corners_on_table(
    board: Board, found: Detection, T_base_picture: Array, board_scale: float = 1.0, plate: float = 0.0
) -> Array:
    """The pattern's corners, lowered by the plate's thickness [m], in the base frame. Shape (4, 3).

    `board_scale` is the true size of the print over its nominal one, as a calibration with it found.
    """
    T_picture_board = found.T_cam_board.copy()
    T_picture_board[:3, 3] *= board_scale
    below = board.outline * board_scale + np.array([0.0, 0.0, plate])
    return transform_points(T_base_picture @ T_picture_board, below)


def marked_table(corners: Sequence[Array], looked: int) -> TouchedTable:
    """The workspace whose middle is the board's middle, from its corners (4, 3) in each picture, base frame [m].

    `looked` is the number of pictures taken.

    Raises:
        Refused: the board was hardly ever found, the pictures disagree, or the board does not lie level.
    """
    if len(corners) < LEAST_PICTURES:
        raise Refused(
            f"the board was found in {len(corners)} of {looked} pictures, needed are {LEAST_PICTURES}. Look at what "
            "the camera sees: evg-app camera preview; is it the board of --marker, whole in the picture, and sharp?"
        )
    return touched_table(np.concatenate(corners), BOARD)
