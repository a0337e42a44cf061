"""The printed board has the size that the YAML says."""

import re
import zlib

import numpy as np
import pypdfium2 as pdfium
import pytest

from evg_app.cli.main import main
from evg_app.errors import BadInput
from evg_app.handeye.boards import Board, load_board
from evg_app.handeye.detect import detect
from evg_app.handeye.paper import RULER_MM, write_pdf
from evg_app.types import Intrinsics

POINTS_PER_MM = 72 / 25.4
SIZE_MM = 0.01
PIXELS_PER_MM, PRINTED_MM = 12.0, 0.1
"""A renderer puts the edges of a picture on whole pixels."""


@pytest.mark.parametrize("name", ["charuco_a4", "apriltag_a4"])
def test_the_pattern_is_placed_at_its_true_size(name, tmp_path):
    board, path = load_board(name), tmp_path / "board.pdf"
    write_pdf(board, path)
    data = path.read_bytes()
    width, height = (
        float(v) / POINTS_PER_MM for v in re.search(rb"q ([\d.]+) 0 0 ([\d.]+) [\d.]+ [\d.]+ cm /Im Do", data).groups()
    )
    assert (width, height) == pytest.approx([1000 * side for side in board.model.size], abs=SIZE_MM)


def test_the_picture_in_the_file_is_the_pattern(tmp_path):
    board, path = load_board("charuco_a4"), tmp_path / "board.pdf"
    write_pdf(board, path)
    data = path.read_bytes()
    columns, rows = (int(v) for v in re.search(rb"/Width (\d+) /Height (\d+)", data).groups())
    stream = data[data.index(b"/FlateDecode") :]
    bits = zlib.decompress(stream[stream.index(b"stream\n") + 7 : stream.index(b"\nendstream")])
    picture = np.unpackbits(np.frombuffer(bits, np.uint8).reshape(rows, -1), axis=1)[:, :columns]
    assert picture.shape == board.picture(20000.0).shape
    assert np.array_equal(picture > 0, board.picture(20000.0) > 127)


def test_a_board_that_does_not_fit_is_refused(tmp_path):
    model = load_board("charuco_a4").model.model_copy(update={"square_m": 0.06})
    with pytest.raises(BadInput, match="does not fit on a4"):
        write_pdf(Board(model), tmp_path / "big.pdf")


def test_a_new_board_gets_pdf_and_yaml(tmp_path, capsys):
    words = ["--kind", "apriltag-grid", "--columns", "3", "--rows", "3", "--square-mm", "40", "--marker-mm", "10"]
    out = tmp_path / "calibration" / "boards"
    assert main(["calibrate", "board", "mine", *words, "--out", str(out)]) == 0
    assert (out / "mine.pdf").is_file()
    assert load_board("mine", tmp_path).model.columns == 3


@pytest.mark.parametrize("name", ["charuco_a4", "apriltag_a4"])
def test_the_printed_page_shows_the_board_and_a_ruler_of_its_length(name, tmp_path):
    board, path = load_board(name), tmp_path / "board.pdf"
    write_pdf(board, path)
    page = pdfium.PdfDocument(path)[0].render(scale=PIXELS_PER_MM / POINTS_PER_MM, grayscale=True).to_numpy()
    flat = Intrinsics(page.shape[1], page.shape[0], 1000.0, 1000.0, page.shape[1] / 2, page.shape[0] / 2)
    found = detect(board, np.ascontiguousarray(page), flat)
    assert len(found.ids) == len(board.points)
    printed = found.pixels - found.pixels.mean(axis=0)
    true = 1000 * (board.points[found.ids] - board.points.mean(axis=0))[:, :2]
    assert np.abs(printed / PIXELS_PER_MM - true).max() < PRINTED_MM
    foot = page[-round(19.5 * PIXELS_PER_MM) : -round(18.5 * PIXELS_PER_MM)]
    ticks = np.flatnonzero((foot < 128).all(axis=0))
    assert (ticks[-1] - ticks[0]) / PIXELS_PER_MM == pytest.approx(RULER_MM, abs=0.3)
