"""What depth says beside the corners: its scale against the board, and where the table is."""

from dataclasses import replace

import numpy as np
import pytest

from evg_app.geometry import make
from evg_app.handeye import diagnose
from evg_app.handeye.boards import load_board
from evg_app.handeye.detect import detect
from evg_app.handeye.rigid import exp
from evg_app.handeye.sample import Sample, Session, coarse
from evg_app.handeye.standin.picture import BoardPainter, Exposure
from evg_app.handeye.table import depth_factor, fit_table, table_findings

FACTOR, TILT_DEG, OFFSET_MM, FLAT_MM = 0.005, 0.3, 2.0, 3.0
UNIT, NOISE = 0.001, 0.0015


def lying(factor, lens, count=4):
    """A camera beside a table that looks at a board in front of it; depth is `factor` times too large."""
    board, rng = load_board("charuco_a4"), np.random.default_rng(2)
    painter = BoardPainter(board, lens)
    X = make(exp(np.array([0.5 - np.pi, 0.0, 0.0])), np.array([0.15, -0.25, 0.75]))
    T_task_table = make(np.eye(3), np.array([0.0, 0.0, 0.05]))
    samples = []
    for k in range(count):
        R = exp(np.array([0.3, 0.2 * k - 0.3, 0.1]))
        T = make(R, np.array([-0.25, -0.1, 0.5]) - R @ board.center)
        gray = painter.paint(T, Exposure(seed=k))
        depth = painter.depth(T, np.linalg.inv(X) @ T_task_table, factor, NOISE, UNIT, rng)
        found = detect(board, gray, lens)
        at = np.rint(found.pixels).astype(int)
        samples.append(
            Sample(k, np.zeros(7), np.eye(4), found, None, depth[at[:, 1], at[:, 0]] * UNIT, coarse(depth, UNIT))
        )
    session = Session("eye-to-hand", "r", "c", "base", "cam", lens, board, np.eye(4), tuple(samples))
    return session, X


@pytest.mark.parametrize("factor", [1.0, 1.08])
def test_the_scale_of_depth_is_measured_against_the_board(factor, lens):
    session, _ = lying(factor, lens)
    found = depth_factor(session, 1.0)
    assert found == pytest.approx(1 / factor, abs=FACTOR)
    assert [f.cause for f in diagnose.depth_check(found)] == (["depth"] if factor > 1.05 else [])


def test_a_good_result_puts_the_table_where_it_is(lens):
    session, X = lying(1.0, lens)
    table = fit_table(session, X, 1.0)
    assert table.tilt_deg < TILT_DEG and abs(table.offset_mm) < OFFSET_MM and table.flatness_mm < FLAT_MM
    assert table_findings(table) == []


def test_a_wrong_camera_tilts_and_lifts_the_table(lens):
    session, X = lying(1.0, lens)
    wrong = make(exp(np.array([0.05, 0.0, 0.0])) @ X[:3, :3], X[:3, 3])
    (finding,) = table_findings(fit_table(session, wrong, 1.0))
    assert finding.cause == "table" and "tilted" in finding.text


def test_without_depth_nothing_is_said(lens):
    session, X = lying(1.0, lens)
    blind = session.with_samples(
        [replace(s, board_depth=np.zeros(0), coarse_depth=np.zeros((0, 0), np.float32)) for s in session.samples]
    )
    assert depth_factor(blind, 1.0) == 1.0 and table_findings(fit_table(blind, X, 1.0)) == []
