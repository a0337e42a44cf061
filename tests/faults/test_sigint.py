"""Real signals: Ctrl-C once in a motion, twice in a blocking gripper call; the program killed, its terminal closed."""

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


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_kill_and_a_closed_terminal_stop_at_once_and_in_order(number):
    lab = Lab()

    def block(command):
        if command == "grasp":
            os.kill(os.getpid(), number)
            pytest.fail("one signal must leave the gripper call")

    lab.gripper.during = block
    before = signal.signal(number, signal.SIG_DFL)  # whoever runs the tests may ignore it
    try:
        assert lab.run().exit_code == 130 and lab.gripper.stops == 1
        assert lab.outcomes == ["abandoned"] and lab.reasons == ["stopped by the user"]
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, before)


def test_under_nohup_a_run_outlives_its_terminal():
    lab = Lab()
    lab.arm.during["reach"] = once(lambda: os.kill(os.getpid(), signal.SIGHUP))
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert lab.run(rounds=1).exit_code == 0
    finally:
        signal.signal(signal.SIGHUP, before)
