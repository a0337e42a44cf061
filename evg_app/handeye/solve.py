"""From samples to a judged result: starts, refinement, outliers, held-out error, bound, findings, verdict."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evg_app.config.calibration import Verdict
from evg_app.geometry import Array, invert, transform_points
from evg_app.handeye import diagnose
from evg_app.handeye.change import block_of_outliers, find_step
from evg_app.handeye.diagnose import Finding
from evg_app.handeye.hand_noise import polish
from evg_app.handeye.heldout import Heldout, held_out
from evg_app.handeye.refine import FREE_SCALE, SCALE_PRIOR, Fit, corrected, fit_at, lens_between, refine
from evg_app.handeye.rigid import cube_points, displacement
from evg_app.handeye.sample import Sample, Session, Views, views_of
from evg_app.handeye.starts import SOLVERS, best_starts, plain
from evg_app.handeye.table import TableFit, depth_factor, fit_table, table_findings
from evg_app.handeye.uncertainty import Uncertainty, uncertainty
from evg_app.types import Intrinsics

GO_MM, GO_DEG = 3.0, 0.5
"""Held-out error up to which a result is good."""
WARN_MM, WARN_DEG = 5.0, 1.0
"""Held-out error up to which a result may be used with a warning."""
OUTLIER_TIMES, OUTLIER_LEAST_PX, OUTLIER_LEAST_M = 3.5, 0.9, 0.0015
"""A sample is an outlier from this multiple of the median RMS, this RMS [px], and this distance on the board [m] on."""
SUSPICIOUS_PX = 1.5
"""Typical RMS of a sample above which the other mode is tried."""
LENS_WORTH, LENS_ABSURD, LENS_ROUNDS = np.array([0.001, 0.5, 0.5]), 80.0, 2
"""Focal length (relative) and principal point [px] from which on distortion is taken out anew, up to this multiple."""


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
        lens: log focal length over the stream's, and principal point minus the stream's [px]. Shape (3,).
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
    lens: Array
    findings: tuple[Finding, ...]
    verdict: Verdict

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the stream, with the lens that was found."""
        return corrected(self.views.intrinsics, self.fit.lens)

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
    if len(session.usable()) < diagnose.MIN_SAMPLES:
        return Unsolved(tuple(findings))
    nominal, session = session.intrinsics, with_own_lens(session)
    samples = session.usable()
    everything = views_of(session, samples)
    fit, prior, keep = fit_without_outliers(everything)
    if fit is None:
        text = "no solver found a consistent transform: the samples contradict each other"
        return Unsolved((*findings, Finding("no-solution", "refuse", text)))
    views, swapped = everything.take(keep), _swapped(session, everything, fit)
    cube = cube_in_parent(session, session.samples[0].T_base_hand)
    confidence = uncertainty(views, fit, cube, prior)
    factor = depth_factor(session, fit.scale)
    seen = fit_table(session, fit.X, factor)
    lens = lens_between(nominal, corrected(session.intrinsics, fit.lens))
    findings += swapped or _causes(session, everything, keep, fit, prior, confidence)
    findings += [] if swapped else diagnose.lens(lens) + diagnose.depth_check(factor) + table_findings(seen)
    errors = held_out(views, fit, session.board.outline, prior)
    solver_mm = {name: _distance(plain(views, name), fit, cube) for name in SOLVERS}
    if not swapped:
        findings += diagnose.solver_spread(solver_mm) + _gates(errors, confidence)
    used = tuple(sample for sample, kept in zip(samples, keep, strict=True) if kept)
    left_out = tuple(int(n) for n in everything.numbers[~keep])
    verdict = _verdict(findings)
    return Solution(fit, used, left_out, views, errors, confidence, solver_mm, seen, lens, tuple(findings), verdict)


def with_own_lens(session: Session) -> Session:
    """The session with distortion taken out by its own lens, where that differs from what the camera says."""
    for _ in range(LENS_ROUNDS):
        views = views_of(session, session.usable())
        fit, _, _ = fit_without_outliers(views)
        if fit is None or float(np.median(_on_all(views, fit).sample_rms(views))) > SUSPICIOUS_PX:
            break
        if not 1.0 < np.abs(fit.lens / LENS_WORTH).max() < LENS_ABSURD:
            break
        session = session.seen_through(corrected(session.intrinsics, fit.lens))
    return session


def fit_without_outliers(views: Views) -> tuple[Fit | None, float, NDArray[np.bool_]]:
    """The refined fit (None without any start), the prior of the board's size, and which samples it rests on."""
    keep = np.ones(len(views), dtype=np.bool_)
    found = [refine(views, s, FREE_SCALE) for s in best_starts(views, count=3)]
    if not found:
        return None, FREE_SCALE, keep
    fit = min(found, key=lambda f: float(np.log1p((f.residuals**2).sum(axis=1)).sum()))
    for _ in range(3):
        new = _consistent(fit.sample_rms(views), views)
        if new.sum() < diagnose.MIN_SAMPLES // 2 or (new == keep).all():
            break
        keep = new
        fit = _on_all(views, refine(views.take(keep), fit, FREE_SCALE))
    part = views.take(keep)
    free = polish(part, refine(part, fit, FREE_SCALE), FREE_SCALE)
    cube = transform_points(free.X, np.array([[0.0, 0.0, 0.5]]))
    std = uncertainty(part, free, cube, FREE_SCALE).scale_std
    if diagnose.board_size(free.scale, std, 1.0):
        return free, FREE_SCALE, keep
    tied = refine(part, fit_at(part, fit.X, fit.Z, 1.0, fit.lens), SCALE_PRIOR)
    return polish(part, tied, SCALE_PRIOR), SCALE_PRIOR, keep


def _consistent(rms: Array, views: Views) -> NDArray[np.bool_]:
    """Which samples are no outliers by their RMS residual (N,) [px]. Shape (N,)."""
    on_board = rms * views.B[:, 2, 3] / views.intrinsics.fx
    far = rms > max(OUTLIER_TIMES * float(np.median(rms)), OUTLIER_LEAST_PX)
    return np.asarray(~(far & (on_board > OUTLIER_LEAST_M)))


def _on_all(views: Views, fit: Fit) -> Fit:
    """The same fit with the residuals of these views."""
    return fit_at(views, fit.X, fit.Z, fit.scale, fit.lens)


def _swapped(session: Session, views: Views, fit: Fit) -> list[Finding]:
    """Whether the samples fit the other mode better."""
    here = float(np.median(_on_all(views, fit).sample_rms(views)))
    if here < SUSPICIOUS_PX:
        return []
    other = views.swapped()
    found = [refine(other, s, FREE_SCALE) for s in best_starts(other, count=2)]
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
    session: Session, everything: Views, keep: NDArray[np.bool_], fit: Fit, prior: float, confidence: Uncertainty
) -> list[Finding]:
    """What is wrong with samples that are of the right mode."""
    views, rms = everything.take(keep), _on_all(everything, fit).sample_rms(everything)
    findings = diagnose.rotations(views, session.mode)
    findings += diagnose.board_size(fit.scale, confidence.scale_std, session.board.model.square_m)
    where = cube_in_parent(session, session.samples[0].T_base_hand), session.board.outline
    step = block_of_outliers(everything, keep, fit, *where, OUTLIER_LEAST_PX)
    if step is None and all(finding.cause != "one-axis" for finding in findings):
        step = find_step(views, fit, *where, prior)
    stepped = diagnose.moved(step, everything.numbers, session.mode)
    if not stepped:
        left_out = [int(n) for n in everything.numbers[~keep]]
        stepped = diagnose.outliers(left_out, rms[~keep].tolist(), len(everything), float(np.median(rms)))
    return findings + stepped


def _distance(found: tuple[Array, Array] | None, fit: Fit, cube: Array) -> float | None:
    """Displacement over the cube [mm] of a solver's camera from the fit's, None where it failed."""
    return None if found is None else 1000 * displacement(fit.X, found[0], cube)


def _gates(errors: Heldout, confidence: Uncertainty) -> list[Finding]:
    """Held-out error and bound against what is allowed."""
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
    """The worst severity."""
    severities = {finding.severity for finding in findings}
    return "refuse" if "refuse" in severities else "warn" if "warn" in severities else "go"
