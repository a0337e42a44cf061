"""The event stream: which outcomes count, and a fan-out that forgets nobody."""

import pytest

from evg_app.events import AttemptOutcome, StateEntered, StopReason, fan_out


def test_only_executed_grasps_count():
    assert {o for o in AttemptOutcome if o.counts} == {AttemptOutcome.SUCCESS, AttemptOutcome.FAILURE}


def test_the_stop_reasons_of_the_issue_exist():
    named = {"cleared", "two consecutive failures", "no grasp", "no feasible grasp", "stopped by the user", "error"}
    assert named <= {str(reason) for reason in StopReason}


def test_every_sink_is_fed_in_order_even_when_one_fails():
    fed = []

    def full(event):
        raise OSError("disk full")

    feed = fan_out(lambda e: fed.append(("a", e)), full, lambda e: fed.append(("b", e)))
    event = StateEntered("look")
    with pytest.raises(OSError, match="disk full"):
        feed(event)
    assert fed == [("a", event), ("b", event)]
    fan_out()(event)


def test_events_cannot_be_changed():
    with pytest.raises(AttributeError):
        StateEntered("look").state = "plan"
