"""From samples to a judged result: starts, refinement, outliers, held-out error, bound, findings, verdict."""

from dataclasses import dataclass

import numpy as np

from evg_app.config.calibration import Verdict
from evg_app.geometry import Array, invert, transform_points
from evg_app.handeye import diagnose
from evg_app.handeye.diagnose import Finding
from evg_app.handeye.heldout import Heldout, held_out
from evg_app.handeye.refine import FREE_SCALE, SCALE_PRIOR, Fit, fit_at, refine
from evg_app.handeye.rigid import cube_points, displacement
from evg_app.handeye.sample import Sample, Session, Views, views_of
from evg_app.handeye.starts import SOLVERS, best_starts, plain
from evg_app.handeye.table import TableFit, depth_factor, fit_table, table_findings
from evg_app.handeye.uncertainty import Uncertainty, uncertainty

GO_MM, GO_DEG = 3.0, 0.5
"""Held-out error up to which a result is good."""
WARN_MM, WARN_DEG = 5.0, 1.0
"""Held-out error up to which a result may be used with a warning."""
OUTLIER_TIMES, OUTLIER_LEAST_PX = 3.5, 0.9
"""A sample is an outlier from this multiple of the median RMS, and at least this RMS [px], on."""
SUSPICIOUS_PX = 1.5
"""Typical RMS of a sample above which the other mode is tried."""


@dataclass(frozen=True)
class Solution:
    """A judged result.

    Attributes:
        fit: camera, board and board size.
        used: the samples it rests on.
        left_out: numbers of usable samples that were outliers.
        views: arrays of `used`.
        heldout, uncertainty: how good it is.
        solver_mm: displacement over the cube of each closed-form solver from the fit [mm], None where it failed.
        table: the fused table, None when depth does not show enough of it.
        findings: everything noticed.
        verdict: what may be done with it.
    """

    fit: Fit
    used: tuple[Sample, ...]
    left_out: tuple[int, ...]
    views: Views
    heldout: Heldout
    uncertainty: Uncertainty
    solver_mm: dict[str, float | None]
    table: TableFit | None
    findings: tuple[Finding, ...]
    verdict: Verdict

    @property
    def reasons(self) -> tuple[str, ...]:
        """The findings in words."""
        return tuple(finding.text for finding in self.findings)


@dataclass(frozen=True)
class Unsolved:
    """No result at all.

    Attributes:
        findings: why.
    """

    findings: tuple[Finding, ...]
    verdict: Verdict = "refuse"

    @property
    def reasons(self) -> tuple[str, ...]:
        """The findings in words."""
        return tuple(finding.text for finding in self.findings)


def cube_in_parent(session: Session, T_base_hand: Array) -> Array:
    """The workspace cube in the camera's parent frame, for the hand at `T_base_hand`. Shape (P, 3)."""
    cube = cube_points(session.T_base_task)
    return cube if session.mode == "eye-to-hand" else transform_points(invert(T_base_hand), cube)


def solve(session: Session) -> Solution | Unsolved:
    """Solve a session and judge the result. A pure function of the session; it holds no truth."""
    findings = diagnose.pictures(session)
    samples = session.usable()
    if len(samples) < diagnose.MIN_SAMPLES:
        return Unsolved(tuple(findings))
    everything = views_of(session, samples)
    fit, prior, keep = fit_without_outliers(everything)
    if fit is None:
        text = "no solver found a consistent transform: the samples contradict each other"
        return Unsolved((*findings, Finding("no-solution", "refuse", text)))
    swapped = _swapped(session, everything, fit)
    left_out = [int(n) for n in everything.numbers[~keep]]
    views = everything.take(keep)
    cube = cube_in_parent(session, session.samples[0].T_base_hand)
    confidence = uncertainty(views, fit, cube, prior)
    factor = depth_factor(session, fit.scale)
    seen = fit_table(session, fit.X, factor)
    findings += swapped or _causes(session, everything, views, fit, confidence, left_out)
    findings += [] if swapped else diagnose.depth_check(factor) + table_findings(seen)
    errors = held_out(views, fit, session.board.outline, prior)
    solver_mm = {name: _distance(plain(views, name), fit, cube) for name in SOLVERS}
    if not swapped:
        findings += diagnose.solver_spread(solver_mm) + _gates(errors, confidence)
    used = tuple(sample for sample, kept in zip(samples, keep, strict=True) if kept)
    return Solution(
        fit, used, tuple(left_out), views, errors, confidence, solver_mm, seen, tuple(findings), _verdict(findings)
    )


def fit_without_outliers(views: Views) -> tuple[Fit | None, float, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """The refined fit (None without any start), the prior of the board's size, and which samples it rests on."""
    keep = np.ones(len(views), dtype=np.bool_)
    found = [refine(views, s.X, s.Z, 1.0, FREE_SCALE) for s in best_starts(views, count=3)]
    if not found:
        return None, FREE_SCALE, keep
    fit = min(found, key=lambda f: float(np.log1p((f.residuals**2).sum(axis=1)).sum()))
    for _ in range(3):
        rms = fit.sample_rms(views)
        new = rms <= max(OUTLIER_TIMES * float(np.median(rms)), OUTLIER_LEAST_PX)
        if new.sum() < diagnose.MIN_SAMPLES // 2 or (new == keep).all():
            break
        keep = new
        fit = _on_all(views, refine(views.take(keep), fit.X, fit.Z, fit.scale, FREE_SCALE))
    part = views.take(keep)
    free = refine(part, fit.X, fit.Z, fit.scale, FREE_SCALE)
    cube = transform_points(free.X, np.array([[0.0, 0.0, 0.5]]))
    std = uncertainty(part, free, cube, FREE_SCALE).scale_std
    if diagnose.board_size(free.scale, std, 1.0):
        return free, FREE_SCALE, keep
    return refine(part, fit.X, fit.Z, 1.0, SCALE_PRIOR), SCALE_PRIOR, keep


def _on_all(views: Views, fit: Fit) -> Fit:
    """The same fit with the residuals of these views."""
    return fit_at(views, fit.X, fit.Z, fit.scale)


def _swapped(session: Session, views: Views, fit: Fit) -> list[Finding]:
    """Whether the samples fit the other mode better."""
    here = float(np.median(_on_all(views, fit).sample_rms(views)))
    if here < SUSPICIOUS_PX:
        return []
    other = views.swapped()
    found = [refine(other, s.X, s.Z, 1.0, FREE_SCALE) for s in best_starts(other, count=2)]
    there = min((float(np.median(f.sample_rms(other))) for f in found), default=np.inf)
    if there > 0.5 * here:
        return []
    right = "eye-in-hand" if session.mode == "eye-to-hand" else "eye-to-hand"
    text = (
        f"the samples fit {right} ({there:.2f} px) and not {session.mode} ({here:.0f} px): the mode is swapped; run "
        f"again with --mode {right}"
    )
    return [Finding("swapped-mode", "refuse", text)]


def _causes(
    session: Session, everything: Views, views: Views, fit: Fit, confidence: Uncertainty, left_out: list[int]
) -> list[Finding]:
    whole = _on_all(everything, fit)
    rms = whole.sample_rms(everything)
    findings = diagnose.rotations(views, session.mode)
    findings += diagnose.board_size(fit.scale, confidence.scale_std, session.board.model.square_m)
    step = diagnose.moved(everything, views, fit, left_out, session.mode)
    findings += step
    if not step:
        worst = [float(rms[list(everything.numbers).index(n)]) for n in left_out]
        findings += diagnose.outliers(left_out, worst, len(everything), float(np.median(rms)))
    return findings


def _distance(found: tuple[Array, Array] | None, fit: Fit, cube: Array) -> float | None:
    return None if found is None else 1000 * displacement(fit.X, found[0], cube)


def _gates(errors: Heldout, confidence: Uncertainty) -> list[Finding]:
    findings: list[Finding] = []
    mm, deg = errors.rms_mm, errors.rms_deg
    if mm > GO_MM or deg > GO_DEG:
        severity: diagnose.Severity = "warn" if mm <= WARN_MM and deg <= WARN_DEG else "refuse"
        text = f"held-out error {mm:.1f} mm and {deg:.2f} deg; good is up to {GO_MM:g} mm and {GO_DEG:g} deg"
        findings.append(Finding("heldout", severity, text))
    if confidence.bound_mm > GO_MM:
        severity = "warn" if confidence.bound_mm <= WARN_MM else "refuse"
        text = (
            f"the error over the workspace may be up to {confidence.bound_mm:.1f} mm (95 %): take more samples, turn "
            "the hand further, bring the board closer"
        )
        findings.append(Finding("bound", severity, text))
    return findings


def _verdict(findings: list[Finding]) -> Verdict:
    severities = {finding.severity for finding in findings}
    return "refuse" if "refuse" in severities else "warn" if "warn" in severities else "go"
