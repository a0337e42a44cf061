"""Grasps that are no grasps never reach the arm."""

import numpy as np
import pytest

from evg_app.geometry import rotation_about, translation
from evg_app.picking.plan import sane
from evg_app.types import Grasps


def _grasps(n: int) -> Grasps:
    T = np.tile(translation(0.1, 0.1, 0.1) @ rotation_about("x", 3.0), (n, 1, 1))
    return Grasps(T, np.full(n, 0.04), np.linspace(0.9, 0.5, n))


def test_good_grasps_pass_untouched():
    grasps = _grasps(4)
    assert sane(grasps) is grasps


def test_no_grasps_pass():
    assert len(sane(Grasps.empty())) == 0


@pytest.mark.parametrize(
    "spoil",
    [
        lambda g: g.T_task_grasp.__setitem__((1, 0, 0), np.nan),
        lambda g: g.T_task_grasp.__setitem__((1, 2, 3), np.inf),
        lambda g: g.T_task_grasp.__setitem__((1, slice(None, 3), slice(None, 3)), 1.02 * np.eye(3)),
        lambda g: g.T_task_grasp.__setitem__((1, slice(None, 3), slice(None, 3)), np.diag([1.0, 1.0, -1.0])),
        lambda g: g.T_task_grasp.__setitem__((1, 3, 3), 0.0),
        lambda g: g.width.__setitem__(1, np.nan),
        lambda g: g.width.__setitem__(1, -0.01),
        lambda g: g.width.__setitem__(1, 0.9),
        lambda g: g.score.__setitem__(1, np.nan),
    ],
)
def test_a_broken_grasp_is_dropped_and_the_others_stay(spoil):
    grasps = _grasps(4)
    spoil(grasps)
    kept = sane(grasps)
    assert len(kept) == 3 and np.allclose(kept.score, np.linspace(0.9, 0.5, 4)[[0, 2, 3]])


def test_the_best_comes_first_even_when_the_planner_forgot_to_sort():
    grasps = Grasps(_grasps(3).T_task_grasp, np.full(3, 0.04), np.array([0.2, 0.9, 0.5]))
    assert sane(grasps).score.tolist() == [0.9, 0.5, 0.2]
