"""The states that move: look, reach, approach, close, lift, drop, release, return, retreat."""

from typing import Literal

import numpy as np

from evg_app.events import Verified, Warned
from evg_app.geometry import Array
from evg_app.picking.context import ReadyPick
from evg_app.picking.devices import (
    CONTACT,
    at,
    backwards,
    close_gripper,
    contact_guard,
    follow,
    go_to,
    open_gripper,
    resting_fingers,
)
from evg_app.picking.session import Round
from evg_app.picking.states import Outcome, State
from evg_app.picking.verify import held
from evg_app.picking.views import look_around
from evg_app.types import MotionResult, Trajectory

EMPTY_TRIES = 2
"""How often the hand is opened above the bin for what sticks to it."""

Moved = Literal[Outcome.OK, Outcome.BLOCKED]


def look(round_: Round) -> Moved:
    """Begin a pass: open the gripper, look from the further views, go where the arm does not hide the scene."""
    round_.start_attempt()
    open_gripper(round_)
    blocked = look_around(round_)
    if blocked is not None:
        return _ended(round_, blocked)
    return _ended(round_, go_to(round_, "look", look_pose(round_)))


def reach(round_: Round) -> Moved:
    """To the pre-grasp. From here on the pass is an attempt."""
    attempt, referee = round_.now, round_.ctx.referee
    if referee is not None:
        attempt.note(in_bin_before=referee.in_bin())
    attempt.began = True
    return _along(round_, State.REACH, ready(round_).reach)


def approach(round_: Round) -> Moved:
    """Straight to the grasp, cancelled by contact (a software limit, not a safety function)."""
    ctx = round_.ctx
    attempt = round_.now
    attempt.stage = State.APPROACH
    guard = contact_guard(round_)
    result = follow(round_, State.APPROACH, ready(round_).approach, guard)
    touched = not result.reached and result.reason.startswith(CONTACT)
    attempt.note(contact=touched)
    return Outcome.OK if touched and ctx.settings.close_after_contact else _ended(round_, result)


def close(round_: Round) -> Literal[Outcome.OK]:
    """Close the fingers and keep what the device says about it."""
    round_.now.stage, round_.now.closed = State.CLOSE, True
    result = close_gripper(round_)
    round_.now.note(width_closed=result.width, gripper_success=result.success)
    return Outcome.OK


def lift(round_: Round) -> Moved:
    """Up, whether or not the fingers closed on something: only the lift tells."""
    path = ready(round_).lift
    if at(round_, path.q[0]):
        return _along(round_, State.LIFT, path)
    round_.now.stage = State.LIFT
    return _ended(round_, go_to(round_, State.LIFT, path.q[-1], around_scene=False))


def drop(round_: Round) -> Moved:
    """To above the bin; on a planned path, or a new one after a recovery."""
    transport = ready(round_).transport
    round_.now.stage = State.DROP
    if at(round_, transport.q[0]):
        return _ended(round_, follow(round_, State.DROP, transport))
    return _ended(round_, go_to(round_, State.DROP, np.asarray(round_.ctx.robot.drop.q_rad)))


def release(round_: Round) -> Literal[Outcome.OK]:
    """Look at the fingers once more when they rest, then open them over the bin."""
    state = resting_fingers(round_)
    attempt = round_.now
    attempt.held_release = held(state, round_.ctx.robot.gripper)
    attempt.note(width_release=state.width, is_grasped_release=state.is_grasped)
    round_.emit(Verified("release", state, attempt.held_release))
    attempt.released = True
    open_gripper(round_)
    if round_.ctx.referee is None and round_.ctx.robot.evidence.check_empty_hand:
        _empty_hand(round_)
    return Outcome.OK


def _empty_hand(round_: Round) -> None:
    """Close the fingers above the bin: what sticks to one of them stops them, and is opened for once more.

    An empty hand stays closed until the next look opens it.
    """
    for _ in range(EMPTY_TRIES):
        width = close_gripper(round_).width
        round_.now.note(width_emptied=width)
        if width <= round_.ctx.robot.gripper.held_width_m:
            return
        round_.emit(
            Warned("still in the hand", f"the fingers opened above the bin and then closed to {width * 1e3:.1f} mm")
        )
        open_gripper(round_)


def return_(round_: Round) -> Moved:
    """From the bin back to the look pose."""
    back = ready(round_).back
    round_.now.stage = State.RETURN
    if at(round_, back.q[0]):
        result = follow(round_, State.RETURN, back)
        if not result.reached:
            return _ended(round_, result)
    return _ended(round_, go_to(round_, State.RETURN, look_pose(round_)))


def retreat(round_: Round) -> Moved:
    """Without an object: open, back out of the scene the way the arm came, and to the look pose."""
    open_gripper(round_)
    decision = round_.now.decision
    if decision is not None and decision.pick is not None and round_.now.began:
        result = _back_out(round_, decision.pick)
        if not result.reached:
            return _ended(round_, result)
    return _ended(round_, go_to(round_, State.RETREAT, look_pose(round_)))


def _back_out(round_: Round, pick: ReadyPick) -> MotionResult:
    """Leave the neighbourhood of the objects on paths that were judged before."""
    stage = round_.now.stage
    known: Trajectory | None = None
    if stage in (State.APPROACH, State.CLOSE) or (stage is State.REACH and at(round_, pick.reach.q[-1])):
        known = backwards(pick.reach)
    elif stage in (State.LIFT, State.VERIFY):
        known = pick.retreat
    if known is None:
        return MotionResult(True, "reached", 0.0)
    result = go_to(round_, "back out", known.q[0], around_scene=False)
    return follow(round_, "back", known) if result.reached and at(round_, known.q[0]) else result


def ready(round_: Round) -> ReadyPick:
    """The pick that the filter made ready."""
    decision = round_.now.decision
    if decision is None or decision.pick is None:
        raise RuntimeError("no pick is ready")
    return decision.pick


def look_pose(round_: Round) -> Array:
    """Joint positions [rad] from which the camera sees the scene. Shape (J,)."""
    return np.asarray(round_.ctx.robot.look_q_rad, dtype=np.float64)


def _along(round_: Round, state: State, trajectory: Trajectory) -> Moved:
    """Follow a trajectory in this state."""
    round_.now.stage = state
    return _ended(round_, follow(round_, state, trajectory))


def _ended(round_: Round, result: MotionResult) -> Moved:
    """The outcome of a motion; the reason of one that fell short is kept."""
    if result.reached:
        return Outcome.OK
    round_.now.blocked = round_.now.blocked or result.reason
    return Outcome.BLOCKED
