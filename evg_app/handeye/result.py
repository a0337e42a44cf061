"""A solution as the file that `run` reads, and as the numbers of `--json`."""

from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import numpy as np

from evg_app import __version__
from evg_app.config.calibration import FORMAT, Calibration, Errors, IntrinsicsModel, Witness, pose_of
from evg_app.handeye.sample import Sample, Session
from evg_app.handeye.solve import Solution, Unsolved
from evg_app.trials.provenance import git_commit

WITNESSES = 8
"""Samples whose pose and one corner stand in the file, to notice edits and inversion."""


def as_calibration(
    session: Session, solution: Solution, run: str, forced: bool, now: datetime | None = None
) -> Calibration:
    """The file of a solution."""
    chosen = [solution.used[k] for k in np.linspace(0, len(solution.used) - 1, WITNESSES).astype(int)]
    rejected = len(session.samples) - len(solution.used)
    return Calibration(
        format=FORMAT,
        robot=session.robot,
        camera=session.camera,
        mode=session.mode,
        parent_frame=session.parent_frame,
        camera_frame=session.camera_frame,
        T_parent_cam=pose_of(solution.fit.X @ session.T_picture_cam),
        T_other_board=pose_of(solution.fit.Z),
        T_picture_cam=pose_of(session.T_picture_cam),
        created_utc=(now or datetime.now(UTC)).replace(microsecond=0),
        verdict=solution.verdict,
        forced=forced and solution.verdict == "refuse",
        reasons=solution.reasons,
        errors=Errors(
            heldout_mm=round(solution.heldout.rms_mm, 4),
            heldout_deg=round(solution.heldout.rms_deg, 4),
            bound_mm=round(solution.uncertainty.bound_mm, 4),
            bound_deg=round(solution.uncertainty.bound_deg, 4),
            reprojection_px=round(solution.fit.rms, 4),
            samples=len(solution.used),
            rejected=rejected,
        ),
        board=session.board.model.name,
        board_sha256=session.board.model.sha256,
        board_scale=round(solution.fit.scale, 7),
        intrinsics=IntrinsicsModel.of(solution.intrinsics),
        witnesses=tuple(_witness(session, sample, k) for k, sample in enumerate(chosen)),
        run=run,
        version=__version__,
        commit=git_commit(),
    )


def _witness(session: Session, sample: Sample, k: int) -> Witness:
    """One corner of a sample; `k` varies which."""
    row = (7 * k) % len(sample.detection.ids)
    x, y, z = (float(v) for v in session.board.points[sample.detection.ids[row]])
    u, v = (round(float(value), 3) for value in sample.detection.pixels[row])
    return Witness(T_base_hand=pose_of(sample.T_base_hand), board_point_m=(x, y, z), pixel=(u, v))


def as_facts(session: Session, solution: Solution | Unsolved) -> dict[str, Any]:
    """The numbers of `--json`; without a solution the errors are None."""
    facts: dict[str, Any] = {
        "mode": session.mode,
        "verdict": solution.verdict,
        "reasons": list(solution.reasons),
        "causes": [finding.cause for finding in solution.findings],
        "samples": len(session.usable()),
        "taken": len(session.samples),
        "heldout_mm": None,
        "heldout_deg": None,
        "bound_mm": None,
        "bound_deg": None,
    }
    return facts if isinstance(solution, Unsolved) else facts | _numbers(session, solution)


def _numbers(session: Session, solution: Solution) -> dict[str, Any]:
    """What only a solution has."""
    std = solution.uncertainty.stds()
    return {
        "samples": len(solution.used),
        "heldout_mm": solution.heldout.rms_mm,
        "heldout_deg": solution.heldout.rms_deg,
        "bound_mm": solution.uncertainty.bound_mm,
        "bound_deg": solution.uncertainty.bound_deg,
        "reprojection_px": solution.fit.rms,
        "board_scale": solution.fit.scale,
        "board_scale_std": solution.uncertainty.scale_std,
        "focal_length_off": float(np.expm1(solution.lens[0])),
        "focal_length_std": float(solution.uncertainty.lens_std[0]),
        "principal_point_off_px": solution.lens[1:].tolist(),
        "principal_point_std_px": solution.uncertainty.lens_std[1:].tolist(),
        "translation_std_mm": (1000 * std[:3]).tolist(),
        "rotation_std_deg": np.rad2deg(std[3:]).tolist(),
        "outliers": list(solution.left_out),
        "solvers_mm": solution.solver_mm,
        "T_parent_cam": (solution.fit.X @ session.T_picture_cam).tolist(),
        "table": None if solution.table is None else asdict(solution.table),
        "T_other_board": solution.fit.Z.tolist(),
    }
