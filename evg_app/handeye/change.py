"""Did camera or board move once during the session? A likelihood-ratio test at every possible moment.

The model of `hand_noise` against the same with a camera (or a board) that is elsewhere from sample k on: six more
unknowns. Twice the gain in log likelihood has a chi-square distribution with six degrees of freedom; the threshold
counts every k that is tried. An arm's absolute error varies slowly along the way and can look like a small step, so a
step must also matter: displace workspace or board by `LEAST_M`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from evg_app.geometry import Array, transform_points
from evg_app.handeye.hand_noise import cost, marginal
from evg_app.handeye.placed import Part, place
from evg_app.handeye.refine import UNKNOWNS, Fit, known
from evg_app.handeye.rigid import displacement, moved
from evg_app.handeye.sample import Views

FALSE_ALARMS = 1e-3
"""Share of good sessions in which noise alone may look like a step."""
LEAST_M = 0.00125
"""RMS displacement of workspace or board below which a step is not told from the arm's own error [m]."""
LEAST_SAMPLES = 3
"""On each side of a step."""
LEAST_BLOCK = 2
"""Outliers at one end that may be a step."""
LAST, STEP = UNKNOWNS + 1, 6
COLUMNS: dict[Part, int] = {"camera": 0, "board": 6}
"""First unknown of each part."""


@dataclass(frozen=True)
class Step:
    """A step in a session.

    Attributes:
        first: number of the first sample after it.
        part: what moved.
        size: RMS displacement of the workspace cube (camera) or of the board [m].
        gain: twice the gain in log likelihood; infinite for a block of outliers that agree with each other.
        certain: whether it is one.
    """

    first: int
    part: Part
    size: float
    gain: float
    certain: bool


def size_of(fit: Fit, other: Fit, part: Part, cube_parent: Array, outline: Array) -> float:
    """RMS displacement [m] of the cube (P, 3), or of the board's outline (4, 3), between two fits."""
    if part == "camera":
        return displacement(fit.X, other.X, cube_parent)
    off = transform_points(other.Z, outline) - transform_points(fit.Z, outline)
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def find_step(views: Views, fit: Fit, cube_parent: Array, outline: Array, prior: float) -> Step | None:
    """The likeliest step; None with too few samples.

    Args:
        views, fit: samples without outliers, and the fit to them.
        cube_parent, outline: points over which the size of a step is taken: cube (P, 3), board (4, 3) [m].
        prior: of the board's size, as in `refine`.
    """
    moments = range(LEAST_SAMPLES, len(views) - LEAST_SAMPLES + 1)
    if not moments:
        return None
    levels, penalties = marginal(views, fit)
    before = np.diag(known(prior))
    whole = levels.sum(axis=1)
    still = min(cost(total, before)[0] + penalty for total, penalty in zip(whole, penalties, strict=True))
    best, what = Step(0, "camera", 0.0, -np.inf, False), np.zeros(STEP)
    for k in moments:
        late = levels[:, k:].sum(axis=1)
        for part, column in COLUMNS.items():
            found = [cost(_with_step(*pair, column), before) for pair in zip(whole, late, strict=True)]
            costs = [value + penalty for (value, _), penalty in zip(found, penalties, strict=True)]
            if still - min(costs) > best.gain:
                best = Step(int(views.numbers[k]), part, 0.0, still - min(costs), False)
                what = found[int(np.argmin(costs))][1][UNKNOWNS:]
    camera = best.part == "camera"
    other = Fit(
        moved(fit.X, what) if camera else fit.X, fit.Z if camera else moved(fit.Z, what), fit.scale, fit.residuals
    )
    size = size_of(fit, other, best.part, cube_parent, outline)
    threshold = float(chi2.isf(FALSE_ALARMS / (len(moments) * len(COLUMNS)), STEP))
    return Step(best.first, best.part, size, best.gain, best.gain > threshold and size >= LEAST_M)


def block_of_outliers(
    views: Views, keep: NDArray[np.bool_], fit: Fit, cube_parent: Array, outline: Array, tolerance_px: float
) -> Step | None:
    """Whether the outliers (not `keep`, (N,)) stand at one end and agree on another place of camera or board."""
    n, outliers = len(keep), int((~keep).sum())
    if outliers < LEAST_BLOCK:
        return None
    at_end = [(int((~keep[:k]).sum() + keep[k:].sum()), k, slice(k, n)) for k in range(1, n - LEAST_BLOCK + 1)]
    at_start = [(int(keep[:k].sum() + (~keep[k:]).sum()), k, slice(0, k)) for k in range(LEAST_BLOCK, n)]
    strays, k, where = min(at_end + at_start, key=lambda found: found[0])
    block = np.flatnonzero(~keep[where]) + (where.start or 0)
    if strays > outliers // 4 or len(block) < LEAST_BLOCK:
        return None
    part_views = views.take(block)
    others: dict[Part, Fit] = {part: place(part_views, fit, part) for part in COLUMNS}
    rms = {part: float(np.median(other.sample_rms(part_views))) for part, other in others.items()}
    part: Part = min(others, key=lambda name: rms[name])
    if rms[part] > tolerance_px:
        return None
    size = size_of(fit, others[part], part, cube_parent, outline)
    return Step(int(views.numbers[k]), part, size, np.inf, certain=True)


def _with_step(total: Array, late: Array, column: int) -> Array:
    """Add six unknowns: those from `column` on once more, in the late samples only. (17, 17), (17, 17) -> (23, 23)."""
    order = [*range(UNKNOWNS), *range(LAST, LAST + STEP), UNKNOWNS]
    part = slice(column, column + STEP)
    wide = np.zeros((LAST + STEP, LAST + STEP))
    wide[:LAST, :LAST] = total
    wide[LAST:, :LAST] = late[part]
    wide[:LAST, LAST:] = late[:, part]
    wide[LAST:, LAST:] = late[part, part]
    return wide[np.ix_(order, order)]
