"""A run: rounds for each seed, until they are done, the user stops, or a device gives up."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from evg_app.errors import EvgError, HardwareError, Stopped
from evg_app.events import RunFinished, RunStarted, StopReason
from evg_app.picking.context import Context, Rounds
from evg_app.picking.machine import RoundResult, run_round
from evg_app.picking.session import Emitter


@dataclass(frozen=True)
class RunResult:
    """How a run ended.

    Attributes:
        rounds: those that ran to a named reason, in order.
        stopped: the user asked to stop.
        error: what a device or the log reported, or None.
    """

    rounds: tuple[RoundResult, ...]
    stopped: bool = False
    error: Exception | None = None

    @property
    def exit_code(self) -> int:
        """0 finished, 4 hardware or log, 130 stopped by the user."""
        if self.error is not None:
            return self.error.exit_code if isinstance(self.error, EvgError) else HardwareError.exit_code
        return Stopped.exit_code if self.stopped else 0


def run_rounds(
    ctx: Context, rounds: Rounds, seeds: Sequence[int], count: int, done: Collection[tuple[int, int]] = ()
) -> RunResult:
    """Run `count` rounds for each seed, without those (seed, index) that were `done` in an earlier session.

    The devices are already entered; Ctrl-C and other signals are handled here.

    Raises:
        EvgError: from `rounds.prepare`; anything unexpected is raised after the devices were stopped.
    """
    with ctx.stop.on_signals():
        return _run(ctx, rounds, tuple(seeds), count, done)


def _run(
    ctx: Context, rounds: Rounds, seeds: tuple[int, ...], count: int, before: Collection[tuple[int, int]]
) -> RunResult:
    """The rounds, and one `RunFinished` whatever happens."""
    emitter = Emitter(ctx.sink, ctx.stop)
    emitter.emit(RunStarted(seeds, count, ctx.planner.name, ctx.planner.weights_sha256))
    done: list[RoundResult] = []
    status, detail = "error", "ended unexpectedly"
    try:
        units = [(s, i) for s in seeds for i in range(count) if (s, i) not in before]
        _all_rounds(ctx, emitter, rounds, units, done)
        status, detail = _status(ctx, emitter, done)
    except Stopped as error:
        status, detail = "stopped by the user", str(error)
    except Exception as error:
        detail = f"{type(error).__name__}: {error}"
        raise
    finally:
        emitter.emit(RunFinished(status, detail))
    failure = emitter.failure or (HardwareError(detail) if status == "error" else None)
    return RunResult(tuple(done), stopped=status == "stopped by the user", error=failure)


def _all_rounds(
    ctx: Context, emitter: Emitter, rounds: Rounds, units: Sequence[tuple[int, int]], done: list[RoundResult]
) -> None:
    """Round after round until a stop or an error."""
    for seed, index in units:
        if ctx.stop.soft:
            return
        objects = rounds.prepare(index, seed)
        result = run_round(ctx, emitter, seed, index, objects)
        done.append(result)
        if result.stop_reason is StopReason.ERROR:
            return


def _status(ctx: Context, emitter: Emitter, done: Sequence[RoundResult]) -> tuple[str, str]:
    """How the run ended, and more about it."""
    if emitter.failure is not None:
        return "error", f"the log failed: {emitter.failure}"
    if done and done[-1].stop_reason is StopReason.ERROR:
        return "error", done[-1].detail
    return ("stopped by the user", "") if ctx.stop.soft else ("finished", "")
