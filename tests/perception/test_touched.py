"""The workspace from touches: exact on a plane, refused when the touches cannot be trusted."""

import numpy as np
import pytest

from evg_app.errors import Refused
from evg_app.perception.touched import touched_table

EXACT_M = 1e-9
SQUARE = np.array([[0.35, -0.15, 0.0], [0.35, 0.15, 0.0], [0.65, 0.15, 0.0], [0.65, -0.15, 0.0]])


def test_the_shipped_square_gives_the_shipped_workspace():
    table = touched_table(SQUARE)
    np.testing.assert_allclose(table.origin, (0.35, -0.15, -0.05), atol=EXACT_M)
    assert table.height == pytest.approx(0.0, abs=EXACT_M) and table.tilt_deg == pytest.approx(0.0, abs=1e-6)


def test_a_higher_table_elsewhere_moves_the_workspace_with_it():
    table = touched_table(SQUARE + np.array((0.1, -0.05, 0.123)))
    np.testing.assert_allclose(table.origin, (0.45, -0.20, 0.073), atol=EXACT_M)


def test_a_slight_tilt_is_measured():
    points = SQUARE.copy()
    points[:, 2] = np.tan(np.deg2rad(0.5)) * (points[:, 0] - 0.5)
    table = touched_table(points)
    assert table.tilt_deg == pytest.approx(0.5, abs=1e-6) and table.height == pytest.approx(0.0, abs=EXACT_M)


@pytest.mark.parametrize(
    ("points", "why"),
    [
        (SQUARE[:3], "3 of kind 'touch', needed are 4"),
        (np.repeat(SQUARE[:1], 4, axis=0), "span"),
        (SQUARE + np.outer((0.02, 0, 0, 0), (0, 0, 1)), "off the plane"),
        (SQUARE + np.outer((0, 0, 0.02, 0.02), (0, 0, 1)), "tilted"),
    ],
)
def test_touches_that_make_no_table_are_refused(points, why):
    with pytest.raises(Refused, match=why):
        touched_table(points)
