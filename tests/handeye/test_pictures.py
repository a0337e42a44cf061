"""The real detector on rendered pictures: accuracy, and pictures that must not be used."""

import numpy as np
import pytest

from evg_app.config.calibration import project
from evg_app.geometry import make, transform_points
from evg_app.handeye.boards import load_board
from evg_app.handeye.detect import detect
from evg_app.handeye.rigid import exp
from evg_app.handeye.standin.picture import BoardPainter, Exposure

CORNER_PX = {"charuco_a4": 0.15, "apriltag_a4": 0.08}
"""RMS distance of found from true corners in each direction."""
BIAS_PX = 0.05


def view(board, turn=(0.3, -0.2, 0.1), z=0.5):
    R = exp(np.array(turn))
    return make(R, np.array([0.02, -0.01, z]) - R @ board.center)


@pytest.fixture(scope="module")
def painter(board, lens):
    return BoardPainter(board, lens)


@pytest.mark.parametrize("name", sorted(CORNER_PX))
def test_corners_are_found_where_they_are(name, lens):
    board = load_board(name)
    painter, off = BoardPainter(board, lens), []
    for k, turn in enumerate([(0.3, -0.2, 0.1), (-0.4, 0.1, 0.8), (0.1, 0.5, -0.5)]):
        T = view(board, turn)
        found = detect(board, painter.paint(T, Exposure(seed=k, gain=0.6 + 0.3 * k)), lens)
        assert found.ok and len(found.ids) > 0.8 * len(board.points)
        off.append(found.pixels - project(lens, transform_points(T, board.points[found.ids])))
    errors = np.concatenate(off)
    assert np.sqrt((errors**2).mean(axis=0)).max() < CORNER_PX[name]
    assert np.abs(errors.mean(axis=0)).max() < BIAS_PX


def test_a_partly_hidden_board_gives_the_rest(board, lens, painter):
    T = view(board)
    u, v = project(lens, transform_points(T, board.points[0]))
    found = detect(board, painter.paint(T, Exposure(hidden=((float(u), float(v), 25.0),))), lens)
    assert found.ok and 0 not in found.ids and len(found.ids) >= 15


def test_blur_by_motion_is_called_blur(board, lens, painter):
    for motion in ((6.0, 0.0), (9.0, 6.0)):
        assert detect(board, painter.paint(view(board), Exposure(motion=motion)), lens).problem == "blurred"


def test_an_oblique_board_is_not_used(board, lens, painter):
    found = detect(board, painter.paint(view(board, (1.25, 0.0, 0.0), 0.4), Exposure()), lens)
    assert not found.ok


def test_a_picture_without_a_board_says_so(board, lens, painter):
    found = detect(board, painter.paint(view(board, z=-0.5), Exposure()), lens)
    assert found.problem == "board not found"
