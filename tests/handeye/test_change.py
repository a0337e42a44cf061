"""One move during a session: found where it is, told from noise, from a wrong lens and from outliers."""

from dataclasses import replace

import numpy as np
import pytest

from evg_app.geometry import invert
from evg_app.handeye import diagnose
from evg_app.handeye.change import block_of_outliers, find_step
from evg_app.handeye.refine import SCALE_PRIOR, project_all
from evg_app.handeye.rigid import cube_points, moved
from evg_app.handeye.solve import OUTLIER_LEAST_PX, fit_without_outliers

CUBE = cube_points(np.eye(4))
CORNER_PX, HAND_M, HAND_RAD = 0.07, 2e-4, 3e-4
SIZE_SHARE = 0.35
GOOD_SESSIONS = 5


def session(synthetic, seed, count=22, camera=None, board=None, first=12, hit=()):
    """Views of a noisy arm whose camera or board moves by (6,) at sample `first`; `hit`: samples of wrong joints."""
    views, X, Z = synthetic(count=count, seed=seed)
    rng = np.random.default_rng([seed, 1])
    jitter = rng.normal(0, 1, (count, 6)) * ([HAND_M] * 3 + [HAND_RAD] * 3)
    jitter[list(hit)] = rng.normal(0, 0.02, (len(hit), 6))
    pixels = np.zeros_like(views.pixels)
    for k in range(count):
        late = k >= first
        X_k = moved(X, camera) if late and camera is not None else X
        Z_k = moved(Z, board) if late and board is not None else Z
        one = views.take(np.array([k]))
        one = replace(one, A=one.A @ moved(np.eye(4), jitter[k]))
        pixels[views.sample == k] = project_all(one, X_k, Z_k, 1.0)[1]
        views.B[k] = invert(X_k) @ one.A[0] @ Z_k
    return replace(views, pixels=pixels + rng.normal(0, CORNER_PX, pixels.shape))


def step_of(views, outline):
    """What the solver says about a move."""
    fit, prior, keep = fit_without_outliers(views)
    block = block_of_outliers(views, keep, fit, CUBE, outline, OUTLIER_LEAST_PX)
    return block or find_step(views.take(keep), fit, CUBE, outline, prior)


def test_an_arm_that_only_repeats_badly_has_not_moved(synthetic, board):
    steps = [step_of(session(synthetic, seed), board.outline) for seed in range(GOOD_SESSIONS)]
    assert not any(step.certain for step in steps)


@pytest.mark.parametrize("part", ["camera", "board"])
@pytest.mark.parametrize("millimetres", [3.0, 20.0])
def test_a_move_is_found_with_its_moment_its_size_and_what_moved(part, millimetres, synthetic, board):
    shift = np.array([millimetres * 1e-3, 0, 0, 0, 0, 0])
    step = step_of(session(synthetic, 3, **{part: shift}), board.outline)
    assert step.certain and step.part == part
    assert abs(step.first - 12) <= (1 if millimetres < 10 else 0)
    assert 1000 * step.size == pytest.approx(millimetres, rel=SIZE_SHARE)


def test_a_move_just_before_the_end_is_no_pair_of_outliers(synthetic, board):
    late = session(synthetic, 5, camera=np.array([0.02, 0, 0, 0.01, 0, 0]), first=20)
    assert step_of(late, board.outline).first == 20
    wrong = session(synthetic, 5, hit=(20, 21))
    step = step_of(wrong, board.outline)
    assert step is None or not step.certain


def test_a_wrong_lens_is_no_move(synthetic, board):
    views = session(synthetic, 7)
    wrong = replace(views.intrinsics, fx=views.intrinsics.fx * 1.004, fy=views.intrinsics.fy * 1.004)
    assert not step_of(replace(views, intrinsics=wrong), board.outline).certain


def test_the_finding_names_the_samples_and_the_part(synthetic, board):
    views = session(synthetic, 3, board=np.array([0.004, 0, 0, 0, 0, 0]))
    fit, _, keep = fit_without_outliers(views)
    step = find_step(views.take(keep), fit, CUBE, board.outline, SCALE_PRIOR)
    (finding,) = diagnose.moved(step, views.numbers, "eye-to-hand")
    assert finding.severity == "refuse" and "the board in the hand moved between samples 11 and 12" in finding.text
