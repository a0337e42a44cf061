"""The accounts of the calibration study: what counts as below its bound, repaired, named, or let through."""

import pytest

from evg_app.benchmark.calibration.run import units
from evg_app.benchmark.calibration.summary import summary
from evg_app.benchmark.calibration.units import BAD, SessionRow, faults_of


def row(kind, true_mm, bound_mm, verdict="go", causes=(), mode="eye-to-hand", seed=0, plain=2.0):
    facts = {
        "true_mm": true_mm,
        "true_deg": 0.05,
        "bound_mm": bound_mm,
        "heldout_mm": 0.5,
        "heldout_deg": 0.1,
        "reprojection_px": 0.2,
        "samples": 20,
        "verdict": verdict,
        "causes": list(causes),
    }
    return SessionRow(kind, mode, seed, facts, {"tsai": plain, "three samples (tsai)": None}, {"tsai": 0.1})


def test_a_bound_is_kept_or_not():
    found = summary([row("good", 0.5, 1.0), row("good", 1.2, 1.0, seed=1)])["good"]["eye-to-hand"]
    assert (found["true_below_bound"]["k"], found["true_below_bound"]["n"]) == (1, 2)
    assert found["true_mm"]["median"] == pytest.approx(0.85)
    assert found["plain"]["three samples (tsai)"]["failed"] == 2


def test_refused_or_repaired_and_named_is_what_counts():
    rows = [
        row("outliers", 0.5, 1.0, "warn", ["outliers"]),
        row("outliers", 40.0, 1.0, "refuse", ["outliers"], seed=1),
        row("outliers", 0.5, 1.0, "warn", [], seed=2),
        row("outliers", 9.0, 1.0, "warn", ["outliers"], seed=3),
    ]
    found = summary(rows)["bad"]["outliers"]
    assert (found["named_and_harmless"]["k"], found["named_and_harmless"]["n"]) == (2, 4)
    assert (found["refused"], found["repaired"], found["let_through_above_3_mm"]) == (1, 2, 1)


def test_a_study_plays_every_cause_in_both_modes():
    wanted = units(good=2, bad=1, first=10)
    assert len(wanted) == len(set(wanted)) == 2 * (2 + len(BAD))
    assert {(kind, mode) for kind, mode, _ in wanted} >= {(kind, "eye-in-hand") for kind in BAD}


def test_faults_depend_on_the_seed_alone():
    assert faults_of("moved", "eye-to-hand", 4, 24) == faults_of("moved", "eye-to-hand", 4, 24)
    assert len(faults_of("outliers", "eye-in-hand", 4, 24).wrong_joints) == 5
