"""The samples' likelihood when the hand is never quite where the arm says: last step of a fit, and its confidence.

Model: corners have noise of their own, and at each stop the hand is off by a random shift and turn (repeatability, and
what the arm's model gets wrong). Its size is estimated from the session itself, by largest likelihood. All corners of a
sample move together with the hand, so a sample counts as a few numbers and not as two for each of its corners.
"""

import numpy as np

from evg_app.geometry import Array, transform_points
from evg_app.handeye.refine import ROBUST_PX, UNKNOWNS, Fit, by_point, fit_at, jacobian, known, project_all, through
from evg_app.handeye.rigid import hat, moved
from evg_app.handeye.sample import Views

UNIT = np.full(6, 1e-3)
"""The hand's random shift [m] and turn [rad] per axis, up to a factor."""
SIZES = np.geomspace(0.03, 10.0, 20)
"""Factors that are tried."""
LAST = UNKNOWNS + 1
ROUNDS = 2


def marginal(views: Views, fit: Fit) -> tuple[Array, Array]:
    """What each sample says once its hand's random motion is integrated out, for every size of that motion.

    Returns:
        Information on the unknowns, the last row and column holding gradient and cost. Shape (S, N, 17, 17).
        The part of -2 log likelihood that depends on the size alone. Shape (S,).
    """
    seen, zero, n = through(views, fit.lens), np.zeros(3), len(views)
    J = jacobian(seen, fit.X, fit.Z, fit.scale, zero, zero)
    F = np.concatenate([J, fit.residuals[:, :, None], _by_hand(seen, fit)], axis=2)
    F /= np.sqrt(1.0 + (fit.residuals**2).sum(axis=1) / ROBUST_PX**2)[:, None, None]
    blocks = np.zeros((n, F.shape[2], F.shape[2]))
    np.add.at(blocks, views.sample, np.einsum("mkp,mkq->mpq", F, F))
    own, cross, hand = blocks[:, :LAST, :LAST], blocks[:, :LAST, LAST:], blocks[:, LAST:, LAST:]
    free = cross @ np.linalg.solve(hand, cross.transpose(0, 2, 1))
    within = float((own - free)[:, -1, -1].sum())
    noise = max(within / max(2 * len(F) - 6 * n, 1), 1e-4)
    levels, penalties = [], []
    for size in SIZES:
        certainty = np.diag(noise / (size * UNIT) ** 2)
        inner = certainty + hand
        levels.append((own - cross @ np.linalg.solve(inner, cross.transpose(0, 2, 1))) / noise)
        penalties.append(np.linalg.slogdet(inner)[1].sum() - n * np.linalg.slogdet(certainty)[1])
    return np.stack(levels), np.array(penalties)


def _by_hand(views: Views, fit: Fit) -> Array:
    """Derivative of the residuals by a shift and a turn of the hand in its own frame (sign aside). Shape (M, 2, 6)."""
    p, _, _ = project_all(views, fit.X, fit.Z, fit.scale)
    if views.mode == "eye-to-hand":
        in_hand = transform_points(fit.Z, views.points * fit.scale)
        to_cam = np.einsum("ij,njk->nik", fit.X[:3, :3].T, views.A[:, :3, :3])[views.sample]
    else:
        in_hand = transform_points(fit.X, p)
        to_cam = np.broadcast_to(fit.X[:3, :3].T, (len(p), 3, 3))
    shift = by_point(views, p) @ to_cam
    return np.concatenate([shift, -shift @ hat(in_hand)], axis=2)


def cost(information: Array, before: Array) -> tuple[float, Array]:
    """Least cost of one Gauss-Newton step, and the step. `information`: (P + 1, P + 1); `before`: (16, 16) more."""
    H = np.array(information[:-1, :-1], dtype=np.float64)
    H[:UNKNOWNS, :UNKNOWNS] += before
    H[np.diag_indices_from(H)] *= 1.0 + 1e-9
    g = np.array(information[:-1, -1], dtype=np.float64)
    x = np.asarray(-np.linalg.solve(H, g), dtype=np.float64)
    return float(information[-1, -1] + g @ x), x


def likeliest(views: Views, fit: Fit, prior: float) -> tuple[Array, Array]:
    """Each sample's information (N, 17, 17) at the likeliest size of the hand's motion, and the best step (16,)."""
    levels, penalties = marginal(views, fit)
    before = np.diag(known(prior))
    found = [cost(_pulled(level.sum(axis=0), fit, prior), before) for level in levels]
    best = int(np.argmin([value + penalty for (value, _), penalty in zip(found, penalties, strict=True)]))
    return levels[best], found[best][1]


def _pulled(total: Array, fit: Fit, prior: float) -> Array:
    """The sum of all samples' information (17, 17) with the pull of what is known on scale and lens."""
    pulled: Array = total.copy()
    pull = known(prior)[12:] * np.concatenate([[np.log(fit.scale)], fit.lens])
    pulled[12:UNKNOWNS, -1] += pull
    pulled[-1, 12:UNKNOWNS] += pull
    return pulled


def polish(views: Views, fit: Fit, prior: float) -> Fit:
    """A fit moved to the largest likelihood of this model; it must be near. `prior`: as in `refine`."""
    for _ in range(ROUNDS):
        x = likeliest(views, fit, prior)[1]
        scale = fit.scale * float(np.exp(np.clip(x[12], -1, 1)))
        fit = fit_at(views, moved(fit.X, x[:6]), moved(fit.Z, x[6:12]), scale, fit.lens + x[13:])
    return fit
