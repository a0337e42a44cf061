"""The live picture: drawn with each look, and served to a browser."""

import io
from urllib.error import HTTPError
from urllib.request import urlopen

import numpy as np
import pytest
from PIL import Image

from evg_app.errors import BadInput
from evg_app.geometry import make
from evg_app.handeye.boards import load_board
from evg_app.handeye.detect import detect
from evg_app.handeye.live import LivePicture
from evg_app.handeye.live_page import LivePage
from evg_app.handeye.rigid import exp
from evg_app.handeye.sample import Sample
from evg_app.handeye.standin.picture import BoardPainter, Exposure

PATIENCE = 10.0


def look(number, x, lens):
    """A sample of the board at `x` [m]."""
    board, R = load_board("charuco_a4"), exp(np.array([0.2, 0.1, 0.0]))
    gray = BoardPainter(board, lens).paint(make(R, np.array([x, 0.0, 0.5]) - R @ board.center), Exposure())
    return Sample(number, np.zeros(7), np.eye(4), detect(board, gray, lens), gray)


def coloured(picture, channel):
    """How many pixels are mostly of one colour (0 red, 1 green, 2 blue)."""
    rgb = np.asarray(picture, dtype=int)
    others = rgb[:, :, [k for k in range(3) if k != channel]].max(axis=2)
    return int((rgb[:, :, channel] - others > 40).sum())


def test_corners_are_green_and_those_of_samples_before_stay_as_blue_dots(tmp_path, lens):
    live = LivePicture(tmp_path)
    live.show(look(0, -0.2, lens))
    first = Image.open(live.path).convert("RGB")
    live.show(look(1, 0.2, lens), taken=False)
    second = Image.open(live.path).convert("RGB")
    assert coloured(first, 1) > 300 and coloured(first, 2) < 50 < coloured(second, 2)


def test_the_page_shows_the_newest_picture_and_nothing_else(tmp_path, lens):
    live = LivePicture(tmp_path)
    (tmp_path / "secret.txt").write_text("no")
    with LivePage(tmp_path, 0) as page:
        assert b"/live.jpg" in urlopen(page.url, timeout=PATIENCE).read()
        for missing in ("live.jpg", "secret.txt", "../live.jpg"):
            with pytest.raises(HTTPError, match="404"):
                urlopen(page.url + missing, timeout=PATIENCE)
        live.show(look(0, 0.0, lens))
        picture = urlopen(page.url + "live.jpg?1", timeout=PATIENCE).read()
        assert Image.open(io.BytesIO(picture)).size == (lens.width, lens.height)


def test_a_taken_port_is_said_with_the_option_that_helps(tmp_path):
    with LivePage(tmp_path, 0) as page, pytest.raises(BadInput, match="--view-port"):
        LivePage(tmp_path, int(page.url.rsplit(":", 1)[1].strip("/")))
