"""The mathematics on synthetic samples: derivatives, every solver, size of the board, outliers, degenerate motion."""

import numpy as np
import pytest

from evg_app.handeye import diagnose
from evg_app.handeye.refine import FREE_SCALE, SCALE_PRIOR, fit_at, jacobian, refine, residuals, through
from evg_app.handeye.rigid import cube_points, displacement, moved
from evg_app.handeye.solve import fit_without_outliers
from evg_app.handeye.starts import SOLVERS, best_starts, plain
from evg_app.handeye.uncertainty import uncertainty

EXACT = 1e-9
DERIVATIVE = 1e-5
CUBE = cube_points(np.eye(4))
MILLIMETRE = 1e-3


def test_the_derivative_is_the_derivative(synthetic):
    views, X, Z = synthetic(count=4)
    rng = np.random.default_rng(1)
    X, Z, at = moved(X, rng.normal(0, 0.05, 6)), moved(Z, rng.normal(0, 0.05, 6)), rng.normal(0, 0.2, 16)

    def error(x):
        """Residuals after a step."""
        return residuals(through(views, x[13:]), moved(X, x[:6]), moved(Z, x[6:12]), float(np.exp(x[12])))

    J = jacobian(
        through(views, at[13:]), moved(X, at[:6]), moved(Z, at[6:12]), float(np.exp(at[12])), at[3:6], at[9:12]
    )
    h = 1e-6
    numeric = np.stack([(error(at + h * e) - error(at - h * e)) / (2 * h) for e in np.eye(16)], axis=-1)
    assert np.abs(J - numeric).max() < DERIVATIVE * np.abs(J).max()


@pytest.mark.parametrize("name", SOLVERS)
def test_every_solver_of_opencv_is_called_with_the_right_frames(name, synthetic):
    views, X, Z = synthetic()
    found = plain(views, name)
    assert found is not None
    assert np.abs(found[0] - X).max() < EXACT
    assert np.abs(found[1] - Z).max() < EXACT


def test_refinement_beats_a_bad_start(synthetic):
    views, X, Z = synthetic(noise=0.1)
    rng = np.random.default_rng(2)
    fit = refine(views, fit_at(views, moved(X, rng.normal(0, 0.05, 6)), moved(Z, rng.normal(0, 0.05, 6))))
    assert displacement(X, fit.X, CUBE) < MILLIMETRE
    assert fit.rms == pytest.approx(0.1 * np.sqrt(2), rel=0.1)


def test_the_size_of_the_board_is_found_and_reported(synthetic):
    views, _, _ = synthetic(noise=0.05, scale=1.03)
    fit, prior, _ = fit_without_outliers(views)
    assert prior == FREE_SCALE
    assert fit.scale == pytest.approx(1.03, abs=1e-3)
    (finding,) = diagnose.board_size(fit.scale, uncertainty(views, fit, CUBE, prior).scale_std, 0.036)
    assert "3.0 %" in finding.text and "37.08 mm" in finding.text


def test_outlying_samples_are_left_out(synthetic):
    views, X, _ = synthetic(noise=0.05)
    wrong = np.array([1, 4, 9, 11])
    for k in wrong:
        views.A[k] = moved(views.A[k], np.array([0.01, 0.02, -0.01, 0.05, 0.0, 0.05]))
    fit, _, keep = fit_without_outliers(views)
    assert set(np.flatnonzero(~keep)) == set(wrong)
    assert displacement(X, fit.X, CUBE) < MILLIMETRE


def test_one_rotation_axis_has_no_usable_bound_and_is_named(synthetic):
    views, X, Z = synthetic(turns=(0.0, 0.0, 0.4), noise=0.05)
    fit = refine(views, fit_at(views, X, Z))
    assert uncertainty(views, fit, CUBE, SCALE_PRIOR).bound_mm > 100
    (finding,) = diagnose.rotations(views, "eye-to-hand")
    assert finding.cause == "one-axis" and finding.severity == "refuse"


def test_diverse_rotations_are_not_complained_about(synthetic):
    views, X, Z = synthetic(noise=0.05)
    assert diagnose.rotations(views, "eye-to-hand") == []
    assert uncertainty(views, refine(views, fit_at(views, X, Z)), CUBE, SCALE_PRIOR).bound_mm < 2


def test_the_swapped_mode_does_not_fit(synthetic):
    views, X, Z = synthetic(noise=0.05)
    assert fit_at(views, X, Z).rms < 0.1
    other = views.swapped()
    wrong = min(np.median(refine(other, s, FREE_SCALE).sample_rms(other)) for s in best_starts(other, 1))
    assert wrong > 5


def test_solvers_that_disagree_are_a_warning():
    assert diagnose.solver_spread({"tsai": 2.0, "park": 3.0, "li": None}) == []
    (finding,) = diagnose.solver_spread({"tsai": 40.0, "park": 30.0, "li": None})
    assert (finding.cause, finding.severity) == ("solvers-disagree", "warn")
