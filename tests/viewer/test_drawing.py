"""What is drawn for a pass: the right things at the right place, in the right colour, as far as the pass came."""

import numpy as np
import pytest

from evg_app.events import FrameTaken, Fused, GraspsPlanned, Judged
from evg_app.geometry import look_at, make, translation
from evg_app.trials.arrays import Gathered
from evg_app.types import Frame, Grasps, Intrinsics, Trajectory, TsdfGrid, Verdict
from evg_app.viewer.colors import VERDICT_COLORS, by_share, by_verdict
from evg_app.viewer.drawing import drawing

CLOUD_ATOL = 2e-3
"""Points against the plane they were seen on: depth comes in millimetres [m]."""
EXACT = 1e-9
CAMERA = Intrinsics(160, 120, 140.0, 140.0, 80.0, 60.0)
T_BASE_TASK = translation(0.35, -0.15, -0.05)
T_BASE_CAM = T_BASE_TASK @ look_at([0.15, 0.15, 0.55], [0.15, 0.15, 0.05], up=(0.0, 1.0, 0.0))
DOWN = make(np.diag([1.0, -1.0, -1.0]), [0.15, 0.15, 0.12])
"""A grasp from above in the middle of the workspace (task frame)."""


def path(n: int, start: float, end: float) -> Trajectory:
    q = np.linspace(start, end, n)[:, None] * np.ones(7)
    return Trajectory(tuple("abcdefg"), 0.01, q, q * 0, q * 0)


def gathered(verdicts=(Verdict.ACCEPTED, Verdict.IK), judged=True) -> Gathered:
    depth = np.full((120, 160), 500, np.uint16)
    depth[0, 0] = 0
    color = np.full((120, 160, 3), 40, np.uint8)
    tsdf, observed = np.zeros((40, 40, 40), np.float32), np.ones((40, 40, 40), bool)
    tsdf[:, :, 6], tsdf[:, :, 7] = 0.4, 0.8
    poses = np.stack([DOWN, DOWN @ translation(0.05, 0, 0)])
    seen = Gathered()
    seen.take(FrameTaken(Frame(depth, 0.001, CAMERA, 1.0, "cam", color), np.zeros(7), T_BASE_CAM, T_BASE_TASK))
    seen.take(Fused(TsdfGrid(tsdf, observed), 100))
    seen.take(GraspsPlanned(Grasps(poses, np.full(2, 0.05), np.array([0.9, 0.4]))))
    if judged:
        paths = {"lift": path(7, 2, 3), "reach": path(5, 0, 1), "approach": path(6, 1, 2)}
        seen.take(Judged(verdicts, 0, False, T_BASE_TASK @ DOWN, paths))
    return seen


def test_the_cloud_lies_on_the_table_that_the_camera_saw():
    drawn = drawing(gathered().arrays())
    assert len(drawn.cloud) == 40 * 54 - 1, "every third pixel, but the one without a measurement"
    assert np.abs(drawn.cloud[:, 2]).max() < CLOUD_ATOL
    assert (drawn.cloud_colors == 40).all() and len(drawn.cloud_colors) == len(drawn.cloud)


def test_voxels_at_the_surface_are_drawn_and_no_others():
    drawn = drawing(gathered().arrays())
    assert len(drawn.voxels) == 1600
    assert drawn.voxels[:, 2] == pytest.approx(-0.05 + 6.5 * 0.0075, abs=EXACT)


def test_every_candidate_is_a_small_gripper_whose_fingers_end_where_the_grasp_says():
    drawn = drawing(gathered().arrays())
    assert drawn.candidates.shape == (8, 2, 3)
    assert drawn.candidates[:4, :, 2].min() == pytest.approx(-0.05 + 0.12 - 0.05, abs=EXACT)
    assert drawn.chosen == pytest.approx(drawn.candidates[:4], abs=EXACT)


def test_candidates_are_coloured_by_their_reason_or_by_their_score():
    drawn = drawing(gathered().arrays())
    assert (drawn.by_verdict[:4] == VERDICT_COLORS[Verdict.ACCEPTED]).all()
    assert (drawn.by_verdict[4:] == VERDICT_COLORS[Verdict.IK]).all()
    assert (drawn.by_score[0, 0] == by_share(np.array([0.9]))[0]).all()
    assert drawn.verdicts == {"accepted": 1, "ik": 1}


def test_the_path_is_in_the_order_it_is_driven_and_knows_where_the_fingers_close():
    drawn = drawing(gathered().arrays())
    assert (np.diff(drawn.path[:, 0]) >= 0).all() and len(drawn.path) == 18
    assert drawn.path[drawn.grasp_at, 0] == 2


def test_a_pass_is_drawn_as_far_as_it_came():
    nothing = drawing(Gathered().arrays())
    assert nothing.image is None and not len(nothing.cloud) and not len(nothing.candidates)
    assert nothing.q is None and not len(nothing.path)
    planned = drawing(gathered(judged=False).arrays())
    assert len(planned.candidates) == 8 and not len(planned.chosen) and not planned.verdicts
    assert (planned.by_verdict == VERDICT_COLORS[Verdict.NOT_EXAMINED]).all()


def test_every_verdict_has_a_colour_of_its_own():
    assert set(VERDICT_COLORS) == set(Verdict) and len(set(VERDICT_COLORS.values())) == len(Verdict)
    assert by_verdict([], 0).shape == (0, 3)


def test_a_better_score_is_lighter_and_nonsense_is_dark():
    shades = by_share(np.array([0.0, 0.5, 1.0, np.nan, 7.0])).astype(int).sum(axis=1)
    assert shades[0] < shades[1] < shades[2] and shades[3] == shades[0] and shades[4] == shades[2]
