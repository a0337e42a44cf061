"""The table of the state machine is total, reachable, and says what the handlers do."""

from typing import get_args, get_type_hints

import pytest

from evg_app.events import StopReason
from evg_app.picking.machine import HANDLERS
from evg_app.picking.states import START, TRANSITIONS, Outcome, State


def _reachable() -> set:
    seen, todo = set(), [START]
    while todo:
        node = todo.pop()
        if node in seen:
            continue
        seen.add(node)
        todo.extend(TRANSITIONS[node].values() if isinstance(node, State) else ())
    return seen


@pytest.mark.parametrize("state", State)
def test_every_outcome_a_handler_may_return_has_a_transition_and_no_other(state):
    returned = set(get_args(get_type_hints(HANDLERS[state])["return"]))
    assert returned, f"{state} must annotate its outcomes as a Literal"
    assert set(TRANSITIONS[state]) - {Outcome.STOP, Outcome.FAULT} == returned


@pytest.mark.parametrize("state", State)
def test_a_device_error_has_an_answer_in_every_state(state):
    assert Outcome.FAULT in TRANSITIONS[state]


def test_every_state_and_every_reason_can_be_reached():
    assert _reachable() == set(State) | set(StopReason)


def test_every_state_can_still_end_the_round():
    ends = {s for s in State if any(isinstance(n, StopReason) for n in TRANSITIONS[s].values())}
    while True:
        more = {s for s in State if ends & set(TRANSITIONS[s].values())} | ends
        if more == ends:
            break
        ends = more
    assert ends == set(State)


def test_a_soft_stop_is_ignored_exactly_while_something_may_be_held():
    carrying = {State.CLOSE, State.LIFT, State.VERIFY, State.DROP, State.RELEASE}
    assert all(Outcome.STOP not in TRANSITIONS[state] for state in carrying)
