"""Plan and filter: grasps from the grid, then the first one that the arm can really execute."""

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from evg_app.events import GraspsPlanned, Judged, Stage, Warned
from evg_app.geometry import MAX_OPENING, Array
from evg_app.picking.context import Decision, View
from evg_app.picking.session import Round
from evg_app.picking.states import Outcome
from evg_app.types import Grasps, Verdict

RIGID_TOLERANCE = 1e-3
"""How far R^T R may be from the identity."""


def plan(round_: Round) -> Literal[Outcome.OK, Outcome.NOTHING]:
    """Ask the planner; grasps that are no grasps (NaN, not rigid) are dropped with a warning."""
    attempt = round_.now
    assert attempt.view is not None
    with round_.timed(Stage.PLAN):
        proposed = round_.ctx.planner.plan(attempt.view.tsdf, seed=attempt.planner_seed)
        grasps = sane(proposed)
    if len(grasps) < len(proposed):
        text = f"{round_.ctx.planner.name} proposed {len(proposed) - len(grasps)} grasps that are no rigid poses"
        round_.emit(Warned("broken grasps", text))
    attempt.grasps = grasps
    round_.emit(GraspsPlanned(grasps))
    return Outcome.OK if len(grasps) else Outcome.NOTHING


def filter_(round_: Round) -> Literal[Outcome.OK, Outcome.NOTHING, Outcome.ASK]:
    """Judge the candidates and make the first feasible one ready that no person has rejected."""
    attempt, ctx = round_.now, round_.ctx
    assert attempt.view is not None and attempt.q is not None
    with round_.timed(Stage.JUDGE):
        decision = _decide(round_, attempt.grasps, attempt.view, attempt.q)
    attempt.decision = decision
    pick = decision.pick
    round_.emit(
        Judged(
            decision.verdicts,
            decision.grasp_index,
            decision.flipped,
            None if pick is None else pick.T_base_grasp,
            {} if pick is None else pick.trajectories(),
        )
    )
    return Outcome.NOTHING if pick is None else Outcome.OK if ctx.supervisor is None else Outcome.ASK


def _decide(round_: Round, grasps: Grasps, view: View, q: Array) -> Decision:
    """Judge the candidates that nobody has rejected; the verdicts are about all of them."""
    ctx, rejected = round_.ctx, round_.now.rejected
    if not rejected:
        return ctx.motion.decide(grasps, ctx.perception.T_base_task, view, q)
    kept = [i for i in range(len(grasps)) if i not in rejected]
    if not kept:
        return Decision((Verdict.REJECTED,) * len(grasps), None, None, False)
    others = Grasps(grasps.T_task_grasp[kept], grasps.width[kept], grasps.score[kept])
    decision = ctx.motion.decide(others, ctx.perception.T_base_task, view, q)
    verdicts = [Verdict.REJECTED] * len(grasps)
    for i, verdict in zip(kept, decision.verdicts, strict=True):
        verdicts[i] = verdict
    index = None if decision.grasp_index is None else kept[decision.grasp_index]
    return replace(decision, verdicts=tuple(verdicts), grasp_index=index)


def sane(grasps: Grasps) -> Grasps:
    """Only those with finite, rigid poses, a finite score and a possible width; best first."""
    keep = _rigid(grasps) & np.isfinite(grasps.score) & np.isfinite(grasps.width)
    with np.errstate(invalid="ignore"):
        keep &= (grasps.width >= 0) & (grasps.width <= 2 * MAX_OPENING)
    index = np.flatnonzero(keep)
    index = index[np.argsort(-grasps.score[index], kind="stable")]
    if len(index) == len(grasps) and np.array_equal(index, np.arange(len(grasps))):
        return grasps
    return Grasps(grasps.T_task_grasp[index], grasps.width[index], grasps.score[index])


def _rigid(grasps: Grasps) -> NDArray[np.bool_]:
    """Which poses are rigid transforms. Shape (N,)."""
    T = np.nan_to_num(grasps.T_task_grasp, nan=1e9, posinf=1e9, neginf=-1e9)
    R = T[:, :3, :3]
    orthogonal = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2), initial=0.0) < RIGID_TOLERANCE
    bottom = np.abs(T[:, 3] - np.array([0.0, 0.0, 0.0, 1.0])).max(axis=1, initial=0.0) < RIGID_TOLERANCE
    near = np.abs(T[:, :3, 3]).max(axis=1, initial=0.0) < 10.0
    rigid: NDArray[np.bool_] = orthogonal & bottom & near & (np.linalg.det(R) > 0)
    return rigid
