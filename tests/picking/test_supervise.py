"""A person holds the loop: nothing moves meanwhile, a stop always gets through, a dead supervisor moves nothing."""

import threading
from dataclasses import dataclass, field

import pytest
from picking_fakes import Lab

from evg_app.events import Answer, GraspAnswered, GraspOffered, Held, Judged, MotionStarted
from evg_app.picking.states import TRANSITIONS, State
from evg_app.types import Verdict

NO = Answer(False, "wrong object")
YES = Answer(True)


@dataclass
class Scripted:
    """Holds before a state for some looks, and answers about grasps from a list.

    `hook` is called in every look while it holds, `asked` with every question about a grasp.
    """

    answers: list = field(default_factory=list)
    hold_before: str = ""
    looks: int = 3
    asks: bool = True
    hook: object = None
    asked: object = None

    def may_go_on(self, state, timeout):
        if state != self.hold_before or self.looks <= 0:
            return True
        self.looks -= 1
        if self.hook:
            self.hook()
        return False

    def judge(self, offered, timeout):
        if self.asked:
            self.asked()
        return self.answers.pop(0) if self.answers else None


def test_without_a_supervisor_nobody_is_asked():
    lab = Lab()
    lab.run()
    assert "confirm" not in lab.states and not lab.of(Held)


def test_an_accepted_grasp_is_executed():
    lab = Lab(objects=1, supervisor=Scripted([None, None, YES]))
    lab.run()
    assert lab.outcomes == ["success"]
    assert lab.states[:6] == ["look", "observe", "plan", "filter", "confirm", "reach"]
    assert lab.of(GraspAnswered)[0].answer == YES


def test_a_rejected_grasp_is_logged_with_its_reason_and_the_next_best_is_offered():
    lab = Lab(objects=1, supervisor=Scripted([NO, YES]))
    lab.run()
    assert [offered.index for offered in lab.of(GraspOffered)] == [0, 1]
    assert lab.of(GraspAnswered)[0].answer.reason == "wrong object"
    last = lab.of(Judged)[-1]
    assert last.chosen == 1 and last.verdicts[:2] == (Verdict.REJECTED, Verdict.ACCEPTED)
    assert len(last.verdicts) == 3 and lab.outcomes == ["success"]


def test_when_all_are_rejected_the_round_ends_and_nothing_was_executed():
    lab = Lab(supervisor=Scripted([NO, NO, NO]))
    lab.run()
    assert lab.reasons == ["no feasible grasp"] and "reach" not in lab.states
    assert lab.of(Judged)[-1].verdicts == (Verdict.REJECTED,) * 3


def test_a_supervisor_that_does_not_want_to_be_asked_is_not():
    lab = Lab(objects=1, supervisor=Scripted(asks=False))
    lab.run()
    assert lab.outcomes == ["success"] and not lab.of(GraspOffered)


@pytest.mark.parametrize("state", [s for s in TRANSITIONS if s not in (State.RECOVER, State.RETREAT)])
def test_nothing_moves_while_the_loop_is_held_before_any_state(state):
    lab = Lab(objects=1)
    places = []
    lab.supervisor = Scripted([YES], hold_before=str(state), hook=lambda: places.append((lab.arm.q.copy(), lab.states)))
    lab.run()
    held = [p for p in places if p[1] == places[0][1]]
    assert len(held) >= 3 and all((q == held[0][0]).all() for q, _ in held)
    assert lab.of(Held)[0].state == state and lab.outcomes == ["success"]


def test_a_stop_ends_the_waiting_and_nothing_moves():
    lab = Lab()
    lab.supervisor = Scripted(asked=lab.stop.request_soft)
    result = lab.run()
    assert "reach" not in lab.states and result.stopped
    assert lab.reasons == ["stopped by the user"] and lab.outcomes == ["abandoned"]


def test_a_stop_before_the_first_motion_moves_nothing():
    lab = Lab()
    lab.supervisor = Scripted(hold_before="look", hook=lab.stop.request_soft)
    assert lab.run().stopped and not lab.of(MotionStarted)


def test_a_stop_while_held_above_the_scene_brings_the_arm_out():
    lab = Lab()
    lab.supervisor = Scripted([YES], hold_before="approach", hook=lambda: None)
    lab.supervisor.hook = lambda: lab.states[-1] == "recheck" and lab.stop.request_soft()
    lab.run()
    assert "approach" not in lab.states and lab.states[-2:] == ["retreat", "score"]


def test_two_stops_end_a_hold_at_once():
    lab = Lab()
    lab.supervisor = Scripted(hold_before="drop", hook=lambda: (lab.stop.request(), lab.stop.request()), answers=[YES])
    assert lab.run().exit_code == 130
    assert "drop" not in lab.states and lab.gripper.stops == 1 and lab.gripper.width > 0, "still holds the object"


@pytest.mark.parametrize("where", ["may_go_on", "judge"])
def test_a_supervisor_that_dies_means_hold_and_never_move(where):
    lab = Lab()
    calls = []

    def dead(*_):
        calls.append(1)
        if len(calls) > 50:
            lab.stop.request_soft()
        raise ConnectionError("gone")

    lab.supervisor = Scripted()
    setattr(lab.supervisor, where, dead)
    lab.run()
    assert "reach" not in lab.states and lab.warnings.count("supervisor failed") == 1
    assert lab.reasons == ["stopped by the user"] and len(calls) > 50


def test_a_supervisor_that_comes_back_lets_the_loop_go_on():
    lab = Lab(objects=1)
    calls = []

    def judge(*_):
        calls.append(1)
        if len(calls) < 4:
            raise TimeoutError("late")
        return YES

    lab.supervisor = Scripted()
    lab.supervisor.judge = judge
    lab.run()
    assert lab.outcomes == ["success"]


def test_a_stop_from_another_thread_gets_through_a_hold():
    lab = Lab()
    lab.supervisor = Scripted(hold_before="reach", looks=10**9, asks=False)
    timer = threading.Timer(0.2, lab.stop.request)
    timer.start()
    lab.run()
    assert "reach" not in lab.states
