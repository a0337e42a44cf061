"""What buttons leave at the desk is what the loop finds: no answer without a question, none for the wrong one."""

import os
import threading
from pathlib import Path

import pytest

from evg_app.cli.operator import Operator, Terminal
from evg_app.events import Answer, GraspOffered
from evg_app.picking.stop import StopToken
from evg_app.viewer import desk as desks
from evg_app.viewer.controls import said
from evg_app.viewer.desk import Desk

SOON = 0.02
PATIENCE = 10.0
"""For another thread on a busy core [s]."""
GRASP = GraspOffered(3, 0.8, 0.041, 6.0)


@pytest.fixture
def desk(monkeypatch) -> Desk:
    monkeypatch.setattr(desks, "EARLIEST", 0.0)
    return Desk()


def test_nobody_at_the_desk_holds_nothing(desk):
    assert desk.may_go_on("reach", SOON) and not desk.asks and said(desk) == []


def test_a_pause_holds_before_the_next_state_and_a_step_lets_one_through(desk):
    desk.pause(True)
    assert not desk.may_go_on("reach", SOON)
    assert desk.held_before == "reach" and "held before 'reach'" in said(desk)
    desk.step()
    assert desk.may_go_on("reach", SOON) and not desk.may_go_on("approach", SOON)
    desk.pause(False)
    assert desk.may_go_on("approach", SOON) and not desk.held_before


def test_a_step_nobody_waits_for_is_not_saved_up(desk):
    desk.step()
    desk.pause(True)
    desk.step()
    assert not desk.may_go_on("reach", SOON)


def test_going_on_wakes_the_loop_at_once(desk):
    desk.pause(True)
    assert not desk.may_go_on("reach", SOON)
    threading.Timer(0.05, desk.pause, (False,)).start()
    assert desk.may_go_on("reach", PATIENCE)


@pytest.mark.parametrize(("accepted", "reason"), [(True, ""), (False, "wrong object")])
def test_an_answer_is_about_the_grasp_that_waits(desk, accepted, reason):
    assert desk.judge(GRASP, SOON) is None and "yellow" in said(desk)[0]
    desk.answer(accepted, reason)
    assert desk.judge(GRASP, SOON) == Answer(accepted, reason)
    assert desk.offered is None


def test_an_answer_before_the_question_is_no_answer(desk):
    desk.answer(True)
    assert desk.judge(GRASP, SOON) is None


def test_a_double_click_does_not_answer_the_next_question():
    desk = Desk()
    assert desk.judge(GRASP, SOON) is None
    desk.answer(True)
    assert desk.judge(GRASP, SOON) is None, "nobody can have seen it yet"


def test_a_listener_hears_of_every_change(desk):
    heard = []
    desk.listener = lambda: heard.append(said(desk))
    desk.pause(True)
    desk.may_go_on("lift", SOON)
    desk.pause(False)
    assert heard[:2] == [["will be held before the next state"], ["held before 'lift'"]]


@pytest.fixture
def no_input(monkeypatch):
    """Standard input that never says anything, and one to write to."""
    reading, writing = os.pipe()
    with os.fdopen(reading) as source:
        monkeypatch.setattr("sys.stdin", source)
        yield writing
    os.close(writing)


def test_a_question_of_the_operator_can_be_answered_at_the_desk(desk, no_input):
    operator = Operator(StopToken(), desk)
    desk.listener = lambda: desk.type_in("y") if desk.question and desk.typed() is None else None
    assert operator.confirm("Go?")
    assert desk.question == ""


def test_and_it_can_be_typed_meanwhile(desk, no_input):
    os.write(no_input, b"no\n")
    assert not Operator(StopToken(), desk).confirm("Go?")


def test_the_desk_still_answers_when_the_terminal_is_gone(desk, monkeypatch):
    with Path(os.devnull).open() as gone:
        monkeypatch.setattr("sys.stdin", gone)
        threading.Timer(0.3, desk.type_in, ("?",)).start()
        assert Operator(StopToken(), desk).answer("More in the bin?") == "?"


@pytest.mark.parametrize(("typed", "answer"), [(b"y\n", Answer(True)), (b"too close\n", Answer(False, "too close"))])
def test_the_terminal_alone_can_judge_grasps(no_input, typed, answer):
    os.write(no_input, typed)
    assert Terminal(Operator(StopToken())).judge(GRASP, SOON) == answer


def test_a_stop_while_the_terminal_asks_is_no_answer_and_no_terminal_is_a_no(no_input, monkeypatch):
    stop = StopToken()
    stop.request()
    assert Terminal(Operator(stop)).judge(GRASP, SOON) is None
    with Path(os.devnull).open() as gone:
        monkeypatch.setattr("sys.stdin", gone)
        assert Terminal(Operator(StopToken())).judge(GRASP, SOON) == Answer(False, "no answer")
