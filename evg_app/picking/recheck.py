"""Recheck: with the hand before the grasp, one more look at what the plan was made on."""

from typing import Literal

from evg_app.events import SceneRechecked, Stage, Warned
from evg_app.picking.execute import ready
from evg_app.picking.observe import arm_at_rest, fresh_frame
from evg_app.picking.session import Round
from evg_app.picking.states import Outcome


def recheck(round_: Round) -> Literal[Outcome.OK, Outcome.CHANGED]:
    """Compare a fresh frame with the one planned on, around the grasp; a changed scene is planned on anew.

    What the arm hides from the camera here is not compared.
    """
    ctx, attempt = round_.ctx, round_.now
    model = ctx.camera.recheck
    if not model.enabled:
        return Outcome.OK
    assert attempt.frame is not None and attempt.q is not None
    q = arm_at_rest(round_)
    fresh = fresh_frame(round_, lambda frame: ctx.perception.blind(frame, q))
    with round_.timed(Stage.RECHECK, counts=False):
        change = ctx.perception.change(
            (attempt.frame, attempt.q), (fresh, q), ready(round_).T_base_grasp, model.radius_m, model.depth_m
        )
    attempt.changed = change.area > model.area_m2
    round_.emit(SceneRechecked(attempt.changed, change.area, change.compared))
    if not attempt.changed:
        return Outcome.OK
    text = f"{change.area * 1e4:.1f} cm^2 near the grasp moved since it was planned; planning again"
    round_.emit(Warned("scene changed", text))
    return Outcome.CHANGED
