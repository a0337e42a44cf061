"""Score: what the pass was worth, by the referee's truth or by verify, and whether the round goes on."""

from typing import Literal

from evg_app.events import AttemptFinished, AttemptOutcome, StopReason
from evg_app.picking.evidence import conclude_signs
from evg_app.picking.session import Attempt, Round
from evg_app.picking.states import Outcome

_OUTCOME_OF_REASON = {
    StopReason.CLEARED: AttemptOutcome.EMPTY_VIEW,
    StopReason.NO_GRASP: AttemptOutcome.NO_GRASP,
    StopReason.NO_FEASIBLE: AttemptOutcome.NO_FEASIBLE,
    StopReason.STOPPED: AttemptOutcome.ABANDONED,
    StopReason.ERROR: AttemptOutcome.ERROR,
}


def score(
    round_: Round,
) -> Literal[Outcome.OK, Outcome.CLEARED, Outcome.TWO_FAILURES, Outcome.SPENT]:
    """Count the pass and decide how the round goes on (spec §6.1)."""
    if not (round_.now.fault or round_.now.blocked):
        round_.recoveries = 0
    conclude_signs(round_)
    conclude(round_, None)
    referee, settings = round_.ctx.referee, round_.ctx.settings
    if referee is not None and referee.on_table() == 0:
        return Outcome.CLEARED
    if round_.failures >= settings.max_failures:
        return Outcome.TWO_FAILURES
    return Outcome.SPENT if round_.passes >= settings.max_attempts else Outcome.OK


def conclude(round_: Round, reason: StopReason | None, interrupted: bool = False) -> None:
    """Close the pass under way, if any, and count it. `reason` is given when the round ends with it."""
    attempt = round_.attempt
    if attempt is None:
        return
    truth = None if interrupted else _truth(round_, attempt)
    outcome = _outcome(round_, attempt, reason, truth, interrupted)
    if outcome.counts:
        round_.attempts += 1
        round_.successes += outcome is AttemptOutcome.SUCCESS
        round_.failures = 0 if outcome is AttemptOutcome.SUCCESS else round_.failures + 1
    failure = _failure(attempt, truth) if outcome is AttemptOutcome.FAILURE else ""
    round_.attempt = None
    round_.emit(
        AttemptFinished(
            attempt.attempt_id,
            outcome,
            attempt.verified if attempt.closed else None,
            truth,
            failure,
            attempt.evidence,
            attempt.motion_s,
            attempt.compute_ms,
        )
    )


def _truth(round_: Round, attempt: Attempt) -> bool | None:
    """Whether an object more lies in the bin than before the attempt."""
    before, referee = attempt.evidence.in_bin_before, round_.ctx.referee
    if referee is None or before is None:
        return None
    after = referee.in_bin()
    attempt.note(in_bin_after=after)
    return after > before


def _outcome(
    round_: Round, attempt: Attempt, reason: StopReason | None, truth: bool | None, interrupted: bool
) -> AttemptOutcome:
    """What the pass counts as."""
    if interrupted:
        return AttemptOutcome.ABANDONED
    if not attempt.began:
        if attempt.empty:
            return AttemptOutcome.EMPTY_VIEW
        return AttemptOutcome.ERROR if reason is None else _OUTCOME_OF_REASON[reason]
    if attempt.fault:
        return AttemptOutcome.FAILURE
    if attempt.changed:
        return AttemptOutcome.REPLANNED
    if not attempt.closed and not attempt.blocked and round_.ctx.stop.soft:
        return AttemptOutcome.ABANDONED
    success = truth if truth is not None else attempt.verified
    return AttemptOutcome.SUCCESS if success else AttemptOutcome.FAILURE


def _failure(attempt: Attempt, truth: bool | None) -> str:
    """The reason of a failure, in a few words that count well."""
    if attempt.fault:
        return "device error"
    if not attempt.closed:
        return "contact on approach" if attempt.evidence.contact else "motion aborted"
    if not attempt.held_lifted:
        return "nothing held after lift"
    if not attempt.held_release:
        return "lost in transit"
    if attempt.judged is False:
        return attempt.judged_why
    return "not in the bin" if truth is False else "motion aborted"
