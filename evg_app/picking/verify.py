"""Verify: is something between the fingers? Judged by the opening, never by the device's own word."""

from typing import Literal

from evg_app.config.models import GripperModel
from evg_app.events import Verified
from evg_app.picking.evidence import in_window
from evg_app.picking.session import Round
from evg_app.picking.states import Outcome
from evg_app.types import GripperState


def held(state: GripperState, gripper: GripperModel) -> bool:
    """Whether the fingers stopped on something: not fully closed and not fully open."""
    return in_window(state.width, gripper)


def verify(round_: Round) -> Literal[Outcome.HOLDING, Outcome.EMPTY]:
    """After the lift: held or not. The opening decides; the device's flag is kept beside it."""
    state = round_.ctx.devices.gripper.state()
    attempt = round_.now
    attempt.held_lifted = held(state, round_.ctx.robot.gripper)
    attempt.note(width_lifted=state.width, is_grasped_lifted=state.is_grasped)
    round_.emit(Verified("lift", state, attempt.held_lifted))
    return Outcome.HOLDING if attempt.held_lifted else Outcome.EMPTY
