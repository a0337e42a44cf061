"""Real Ctrl-C signals: once in a motion, twice in a blocking gripper call."""

import os
import signal

import pytest
from picking_fakes import Lab, once

from evg_app.events import RoundStarted


def _ctrl_c() -> None:
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("name", ["look", "reach", "lift"])
def test_ctrl_c_once_finishes_safely(name):
    lab = Lab()
    lab.arm.during[name] = once(_ctrl_c)
    before = signal.getsignal(signal.SIGINT)
    assert lab.run(rounds=2).exit_code == 130
    assert lab.arm.cancels == 0 and lab.reasons == ["stopped by the user"]
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_twice_interrupts_even_a_blocking_gripper_call():
    lab = Lab()

    def block(command):
        if command == "grasp":
            _ctrl_c()
            _ctrl_c()
            pytest.fail("the second Ctrl-C must leave the gripper call")

    lab.gripper.during = block
    result = lab.run()
    assert result.exit_code == 130 and lab.gripper.stops == 1
    assert lab.outcomes == ["abandoned"]


def test_ctrl_c_twice_while_the_log_writes_does_not_tear_the_log():
    lab, written = Lab(), []

    def slow_sink(event):
        if isinstance(event, RoundStarted):
            _ctrl_c()
            _ctrl_c()
        written.append(event)

    lab.listeners.append(slow_sink)
    assert lab.run().exit_code == 130
    assert written == lab.events and lab.reasons == ["stopped by the user"]
