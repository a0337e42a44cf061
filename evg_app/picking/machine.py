"""The driver: walks the table of `states.py` and leaves the devices stopped whatever happens."""

from collections.abc import Callable
from dataclasses import dataclass

from evg_app.errors import EvgError, HardwareError, Refused, Stopped
from evg_app.events import RoundFinished, RoundStarted, StateEntered, StopReason, Warned
from evg_app.picking import execute, observe, plan, recheck, recover, score, supervise, verify
from evg_app.picking.context import Context
from evg_app.picking.session import Emitter, Round
from evg_app.picking.states import START, TRANSITIONS, Outcome, State

HANDLERS: dict[State, Callable[[Round], Outcome]] = {
    State.LOOK: execute.look,
    State.OBSERVE: observe.observe,
    State.PLAN: plan.plan,
    State.FILTER: plan.filter_,
    State.CONFIRM: supervise.confirm,
    State.REACH: execute.reach,
    State.RECHECK: recheck.recheck,
    State.APPROACH: execute.approach,
    State.CLOSE: execute.close,
    State.LIFT: execute.lift,
    State.VERIFY: verify.verify,
    State.DROP: execute.drop,
    State.RELEASE: execute.release,
    State.RETURN: execute.return_,
    State.RETREAT: execute.retreat,
    State.RECOVER: recover.recover,
    State.SCORE: score.score,
}
"""What each state does."""

DEVICE_ERRORS = (HardwareError, Refused)
"""What a handler may raise that the table has an answer to (`FAULT`)."""


@dataclass(frozen=True)
class RoundResult:
    """A finished round; `detail` says more about an error."""

    seed: int
    index: int
    objects: int | None
    attempts: int
    successes: int
    stop_reason: StopReason
    detail: str = ""


def run_round(ctx: Context, emitter: Emitter, seed: int, index: int, objects: int | None) -> RoundResult:
    """Run one round to a named reason.

    Raises:
        Stopped: the user asked twice; the devices are stopped and the round is logged.
    """
    round_ = Round(ctx, emitter, seed, index, objects)
    round_.emit(RoundStarted(seed, index, objects))
    try:
        reason = _drive(round_)
        if reason is StopReason.ERROR:
            halt(round_)
        if reason is StopReason.STOPPED and emitter.failure is not None:
            reason, round_.detail = StopReason.ERROR, f"the log failed: {emitter.failure}"
        return _finish(round_, reason, interrupted=False)
    except (Stopped, KeyboardInterrupt) as error:
        halt(round_)
        _finish(round_, StopReason.STOPPED, interrupted=True)
        raise Stopped("stopped by the user; motion cancelled, gripper left as it was") from error
    except BaseException as error:
        halt(round_)
        round_.detail = f"{type(error).__name__}: {error}"
        _finish(round_, StopReason.ERROR, interrupted=True)
        raise


def _drive(round_: Round) -> StopReason:
    """From state to state until one leads to a reason."""
    state: State | StopReason = START
    supervise.hold(round_, START)
    if round_.ctx.stop.soft:
        return StopReason.STOPPED
    while isinstance(state, State):
        round_.ctx.stop.check()
        round_.emit(StateEntered(state))
        round_.ctx.tick()
        state = TRANSITIONS[state][_step(round_, state)]
    return state


def _step(round_: Round, state: State) -> Outcome:
    """Run one state's handler; device errors become `FAULT`, a request to stop becomes `STOP` where it can."""
    try:
        outcome = HANDLERS[state](round_)
    except DEVICE_ERRORS as error:
        if Outcome.FAULT not in TRANSITIONS[state]:
            raise
        round_.detail = str(error)
        round_.emit(Warned("device error", f"{state}: {error}"))
        if round_.attempt is not None:
            round_.attempt.fault = round_.attempt.fault or f"{state}: {error}"
        return Outcome.FAULT
    if isinstance(following := TRANSITIONS[state][outcome], State):
        supervise.hold(round_, following)
    stoppable = outcome is Outcome.OK and Outcome.STOP in TRANSITIONS[state]
    return Outcome.STOP if stoppable and round_.ctx.stop.soft else outcome


def halt(round_: Round) -> None:
    """Cancel the motion under way and stop the gripper where it is; never raises a device's error."""
    with round_.ctx.stop.shielded():
        for stop in (round_.active.cancel if round_.active else None, round_.ctx.devices.gripper.stop):
            if stop is None:
                continue
            try:
                stop()
            except (EvgError, OSError) as error:
                round_.emit(Warned("stopping failed", str(error)))


def _finish(round_: Round, reason: StopReason, interrupted: bool) -> RoundResult:
    """Close the pass and the round, and tell."""
    with round_.ctx.stop.shielded():
        score.conclude(round_, reason, interrupted)
        detail = round_.detail if reason is StopReason.ERROR else ""
        round_.emit(RoundFinished(round_.seed, round_.index, round_.objects, reason, detail))
    return RoundResult(round_.seed, round_.index, round_.objects, round_.attempts, round_.successes, reason, detail)
