"""A dry run: look, plan and judge with the real devices, check every motion of the pick, and send nothing."""

from collections.abc import Callable, Sequence

from evg_app.errors import EvgError, HardwareError, Refused, Stopped
from evg_app.events import RoundFinished, RoundStarted, RunFinished, RunStarted, StateEntered, StopReason, Warned
from evg_app.picking import score
from evg_app.picking.context import Context, Rounds
from evg_app.picking.devices import at
from evg_app.picking.execute import look_pose
from evg_app.picking.observe import observe
from evg_app.picking.plan import filter_, plan
from evg_app.picking.run import RunResult
from evg_app.picking.session import Emitter, Round
from evg_app.picking.states import Outcome, State
from evg_app.types import Trajectory

STEPS = ((State.OBSERVE, observe), (State.PLAN, plan), (State.FILTER, filter_))
"""What a dry pass does."""

Check = Callable[[str, Trajectory], None]
"""Raises `Refused` for a motion that would not be sent."""


def dry_run(ctx: Context, rounds: Rounds, seeds: Sequence[int], count: int, check: Check) -> RunResult:
    """One dry pass per round; nothing counts as an attempt. Ctrl-C and other signals are handled here."""
    emitter = Emitter(ctx.sink, ctx.stop)
    emitter.emit(RunStarted(tuple(seeds), count, ctx.planner.name, ctx.planner.weights_sha256))
    status, detail = "finished", "dry run: nothing was moved"
    error: EvgError | None = None
    try:
        with ctx.stop.on_signals():
            for seed in seeds:
                for index in range(count):
                    ctx.stop.check()
                    _pass(Round(ctx, emitter, seed, index, rounds.prepare(index, seed)), check)
    except Stopped as stopped:
        status, detail = "stopped by the user", str(stopped)
    except (HardwareError, Refused) as problem:
        status, detail, error = "error", str(problem), problem
    emitter.emit(RunFinished(status, detail))
    return RunResult((), stopped=status == "stopped by the user", error=error or emitter.failure)


def _pass(round_: Round, check: Check) -> None:
    """One dry pass: look, plan, judge, check."""
    round_.emit(RoundStarted(round_.seed, round_.index, round_.objects))
    round_.start_attempt()
    reason, detail = StopReason.ERROR, "a device failed"
    try:
        at_look = at(round_, look_pose(round_))
        if not at_look:
            text = "the arm is not at its look pose and may hide the scene; motions are planned from the look pose"
            round_.emit(Warned("not at look pose", text))
        for state, step in STEPS:
            round_.emit(StateEntered(state))
            if step(round_) is not Outcome.OK:
                break
            if state is State.OBSERVE and not at_look:
                round_.now.q = look_pose(round_)
        _check(round_, check)
        reason, detail = StopReason.STOPPED, "dry run"
    finally:
        score.conclude(round_, reason, interrupted=True)
        round_.emit(RoundFinished(round_.seed, round_.index, round_.objects, reason, detail))


def _check(round_: Round, check: Check) -> None:
    """Check every motion of the pick that would be executed."""
    decision = round_.now.decision
    if decision is None or decision.pick is None:
        return
    for name, trajectory in decision.pick.trajectories().items():
        try:
            check(name, trajectory)
            round_.emit(Warned("dry run", f"{name}: {trajectory.duration:.1f} s, would be sent"))
        except Refused as refusal:
            round_.emit(Warned("dry run", str(refusal)))
