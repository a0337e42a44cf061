"""`calibrate verify`: does a stored result still hold? Fresh poses, nothing fitted but where the board is now."""

from dataclasses import dataclass

import numpy as np

from evg_app.config.calibration import Calibration, Verdict
from evg_app.geometry import Array, invert
from evg_app.handeye.collect import Bench, visit
from evg_app.handeye.heldout import prediction_error
from evg_app.handeye.placed import place
from evg_app.handeye.poses import Reach, plan_stops
from evg_app.handeye.refine import fit_at
from evg_app.handeye.sample import Session, views_of
from evg_app.handeye.solve import GO_DEG, GO_MM, WARN_DEG, WARN_MM

STOPS = 8
"""Fresh poses."""
LEAST = 4
"""Usable samples that a check needs."""


@dataclass(frozen=True)
class Check:
    """What a check found.

    Attributes:
        mm, deg: RMS error of the stored result on the fresh samples; None when there were too few.
        samples: usable ones.
        verdict: by the gates of a calibration.
        reason: in words, empty for go.
    """

    mm: float | None
    deg: float | None
    samples: int
    verdict: Verdict
    reason: str


def fresh_samples(bench: Bench, result: Calibration, seed: int) -> Session:
    """Move to poses that show the board, planned with the stored result, and take samples."""
    first = bench.take(0)
    session = bench.session([first])
    if not first.detection.ok:
        return session
    start = bench.arm.state().q.copy()
    views, X = views_of(session, [first]), picture_pose(session, result)
    Z = invert(views.A[0]) @ X @ views.B[0]
    stops = plan_stops(
        Reach(bench.motion), bench.board, session.intrinsics, bench.mode, fit_at(views, X, Z), views, start, STOPS, seed
    )
    return bench.session([first, *visit(bench, [*(s.q for s in stops), start]).samples])


def check(session: Session, result: Calibration) -> Check:
    """Measure a stored result on samples. Only the board's place is fitted: it may lie elsewhere today.

    The lens is the stored one where the pictures have its size.
    """
    lens = result.intrinsics.value()
    if (lens.width, lens.height) == (session.intrinsics.width, session.intrinsics.height):
        session = session.seen_through(lens)
    samples = session.usable()
    if len(samples) < LEAST:
        reason = f"only {len(samples)} of {len(session.samples)} pictures show the board well; move it into view"
        return Check(None, None, len(samples), "refuse", reason)
    views = views_of(session, samples)
    fit = place(views, fit_at(views, picture_pose(session, result), np.eye(4), result.board_scale), "board")
    errors = np.array(
        [prediction_error(views.take(np.array([k])), fit, session.board.outline) for k in range(len(views))]
    )
    mm, deg = (float(v) for v in np.sqrt((errors[:, :2] ** 2).mean(axis=0)))
    verdict: Verdict = "refuse"
    if mm <= WARN_MM and deg <= WARN_DEG:
        verdict = "go" if mm <= GO_MM and deg <= GO_DEG else "warn"
    reason = "" if verdict == "go" else "the stored result does not fit any more: the camera was moved; calibrate again"
    return Check(mm, deg, len(samples), verdict, reason)


def picture_pose(session: Session, result: Calibration) -> Array:
    """The frame of the session's pictures in the camera's parent frame, by the stored result. Shape (4, 4)."""
    X: Array = result.T_parent_cam.matrix() @ invert(session.T_picture_cam)
    return X
