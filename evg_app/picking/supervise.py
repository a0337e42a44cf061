"""Where a person may hold the loop: between states, and before a planned grasp is executed. Nothing moves meanwhile."""

from collections.abc import Callable
from typing import Literal, TypeVar

from evg_app.events import GraspAnswered, GraspOffered, Held, Warned
from evg_app.picking.session import Round
from evg_app.picking.states import Outcome

T = TypeVar("T")

TO_BIN = ("reach", "approach", "lift", "transport")
"""Motions of a pick until the object is above the bin."""


def hold(round_: Round, state: str) -> None:
    """Wait until the supervisor lets the loop go on to `state`; a request to stop ends the waiting.

    Raises:
        Stopped: the user asked twice.
    """
    supervisor, ctx = round_.ctx.supervisor, round_.ctx
    if supervisor is None or ctx.stop.soft:
        return
    start, waited = ctx.stopwatch(), False

    def asked() -> bool | None:
        """True once it may go on."""
        nonlocal waited
        free = supervisor.may_go_on(state, ctx.settings.slice_s)
        waited = waited or not free
        return free or None

    _until_told(round_, asked)
    if waited:
        round_.emit(Held(state, ctx.stopwatch() - start))


def confirm(round_: Round) -> Literal[Outcome.OK, Outcome.REJECTED]:
    """Ask about the planned grasp, if the supervisor wants to be asked; a rejected one is never offered again.

    Raises:
        Stopped: the user asked twice.
    """
    ctx, attempt = round_.ctx, round_.now
    supervisor, decision = ctx.supervisor, attempt.decision
    if supervisor is None or not supervisor.asks:
        return Outcome.OK
    assert decision is not None and decision.pick is not None and decision.grasp_index is not None
    index, paths = decision.grasp_index, decision.pick.trajectories()
    grasps, duration = attempt.grasps, sum(paths[name].duration for name in TO_BIN)
    offered = GraspOffered(index, float(grasps.score[index]), float(grasps.width[index]), duration)
    round_.emit(offered)
    start = ctx.stopwatch()
    answer = _until_told(round_, lambda: supervisor.judge(offered, ctx.settings.slice_s))
    if answer is None:
        return Outcome.OK  # told to stop: the driver does not go on from here
    round_.emit(GraspAnswered(index, answer, ctx.stopwatch() - start))
    if answer.accepted:
        return Outcome.OK
    attempt.rejected.add(index)
    return Outcome.REJECTED


def _until_told(round_: Round, ask: Callable[[], T | None]) -> T | None:
    """Ask until there is an answer; None when told to stop. A supervisor that fails has not answered.

    Raises:
        Stopped: the user asked twice.
    """
    ctx, failed = round_.ctx, False
    while not ctx.stop.soft:
        answer = None
        try:
            answer = ask()
        except Exception as error:
            if not failed:
                text = f"{type(error).__name__}: {error}; the arm holds until it answers, or until you stop the run"
                round_.emit(Warned("supervisor failed", text))
            failed = True
            ctx.devices.clock.sleep(ctx.settings.slice_s)
        if answer is not None:
            return answer
        ctx.stop.check()
        ctx.tick()
    return None
