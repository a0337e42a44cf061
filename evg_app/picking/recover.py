"""Recover: after a reflex or a motion that fell short, a bounded number of tries, each with its cause logged."""

from typing import Literal

from evg_app.errors import HardwareError
from evg_app.events import Warned
from evg_app.picking.session import Round
from evg_app.picking.states import Outcome
from evg_app.picking.verify import held


def recover(round_: Round) -> Literal[Outcome.OK, Outcome.HOLDING, Outcome.GIVE_UP]:
    """Bring the arm back to idle; `HOLDING` when an object in the fingers should still go to the bin.

    That is tried once: an object that blocked the arm twice is let go where it is.
    """
    attempt, settings = round_.now, round_.ctx.settings
    cause = attempt.fault or attempt.blocked
    round_.recoveries += 1
    attempt.recoveries += 1
    if round_.recoveries > settings.max_recoveries:
        text = f"{settings.max_recoveries} recoveries in a row did not help: {cause}"
        return _give_up(round_, f"{text}. Look at the robot's own page, clear the scene, then run the command again")
    round_.emit(Warned("recovering", cause))
    problem = ""
    for _ in range(settings.recover_tries):
        round_.ctx.stop.check()
        try:
            round_.ctx.devices.arm.recover(settings.recover_timeout_s)
            return _recovered(round_)
        except HardwareError as error:
            problem = str(error)
            round_.emit(Warned("recovery failed", problem))
    return _give_up(round_, f"recovery failed {settings.recover_tries} times: {problem} (first cause: {cause})")


def _recovered(round_: Round) -> Literal[Outcome.OK, Outcome.HOLDING]:
    """Whether an object in the hand still goes to the bin."""
    attempt = round_.now
    round_.emit(Warned("recovered", attempt.fault or attempt.blocked))
    carrying = attempt.closed and not attempt.released
    in_hand = carrying and held(round_.ctx.devices.gripper.state(), round_.ctx.robot.gripper)
    if in_hand and attempt.recoveries > 1:
        round_.emit(Warned("letting go", "the object in hand blocked the arm twice"))
        return Outcome.OK
    return Outcome.HOLDING if in_hand else Outcome.OK


def _give_up(round_: Round, why: str) -> Literal[Outcome.GIVE_UP]:
    """Keep why, and tell."""
    round_.detail = why
    round_.emit(Warned("gave up", why))
    return Outcome.GIVE_UP
