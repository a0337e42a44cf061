"""The driver against programs that speak the Franka protocol: motions, stops, and every fault at the wire."""

import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from fci_motions import TURN, end_of, rests, turn, until_moving
from fci_peers import OBJECT_WIDTH, PEERS, Peer, robot_at, tool_pose_of

from evg_app.errors import HardwareError, LimitViolation, Stopped
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.slower import slowed
from evg_app.robots.fci.arm import FciArm
from evg_app.robots.fci.gripper import FciGripper
from evg_app.robots.fci.messages import Execute
from evg_app.types import ArmMode

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

GOAL_RAD = 0.01
DETECTED_S = 3.0
"""A lost connection must be noticed within this; libfranka itself waits for 1 s."""
SHARE = {"franky-sim": 1.0, "franka-sim": 0.4}
"""Speed of planned motions: on a busy machine franka-sim's arm lags its clock and would seem too fast to itself."""


def arm_at(peer: Peer, **changes: object) -> FciArm:
    robot = robot_at(peer.host, **changes)
    return FciArm(robot, tool_pose_of(robot))


def hand_at(peer: Peer) -> FciGripper:
    return FciGripper(robot_at(peer.host))


def streamer_of(arm: FciArm) -> int:
    pid = arm.process.running().process.pid
    assert pid is not None
    return pid


def pause(pid: int, seconds: float) -> None:
    """Stop a process for a while: what it should have sent is lost."""
    os.kill(pid, signal.SIGSTOP)
    time.sleep(seconds)
    os.kill(pid, signal.SIGCONT)


def test_a_pick_and_drop_without_an_object_runs_on_each_peer(peer: Peer):
    robot = robot_at(peer.host)
    planner, home = MotionPlanner(robot), np.array(robot.home_q_rad)
    with arm_at(peer) as arm, hand_at(peer) as hand:
        hand.move(0.08, 0.1, 10.0)
        for goal in (home, np.array(robot.drop.q_rad)):
            way = planner.go_to(arm.state().q, goal)
            assert way is not None
            assert end_of(arm.execute(slowed(way, SHARE[peer.name]))).reached
            assert np.abs(arm.state().q - goal).max() < GOAL_RAD
            closed = hand.grasp(0.0, 0.1, 30.0, 0.08, 0.08, 10.0)
            assert closed.success
        hand.move(0.07, 0.1, 10.0)
        assert hand.state().width > 0.06
        received, lost, _ = arm.link_quality()
        assert received > 1000 and lost < 0.1 * received


def test_cancel_reaches_the_wire_and_the_arm_holds(peer: Peer):
    with arm_at(peer) as arm:
        goal = turn(arm, 3 * TURN, 2.0)
        motion = arm.execute(goal)
        until_moving(arm, motion)
        motion.cancel()
        result = end_of(motion)
        assert not result.reached and result.reason == "cancelled" and result.goal_error > 0.05
        assert arm.state().mode is ArmMode.IDLE and rests(arm)
        assert end_of(arm.execute(turn(arm, -0.3 * TURN))).reached


def test_leaving_mid_motion_stops_the_arm_first(strict: Peer):
    with arm_at(strict) as arm:
        motion = arm.execute(turn(arm, -3 * TURN, 3.0))
        until_moving(arm, motion)
    with arm_at(strict) as again:
        assert again.state().mode is ArmMode.IDLE and rests(again)


def test_a_motion_that_nobody_looks_at_stops(strict: Peer):
    with arm_at(strict, look_away_s=0.3) as arm:
        motion = arm.execute(turn(arm, 2 * TURN, 3.0))
        time.sleep(2.0)
        result = end_of(motion)
        assert "nobody looked" in result.reason and not result.reached and rests(arm)


def test_lost_packets_are_counted_and_a_few_do_not_matter(strict: Peer):
    with arm_at(strict) as arm:
        motion = arm.execute(turn(arm, -TURN, 2.0))
        until_moving(arm, motion)
        for _ in range(3):
            pause(streamer_of(arm), 0.005)
            assert motion.wait(0.1) is None
        assert end_of(motion).reached
        assert motion.ended is not None and motion.ended.lost >= 3


def test_too_many_lost_packets_are_a_reflex_that_only_recover_ends(strict: Peer):
    with arm_at(strict) as arm:
        motion = arm.execute(turn(arm, TURN, 2.0))
        until_moving(arm, motion)
        pause(streamer_of(arm), 0.15)
        start = time.monotonic()
        result = end_of(motion)
        assert time.monotonic() - start < DETECTED_S
        assert not result.reached and "communication_constraints_violation" in result.reason
        state = arm.state()
        assert state.mode is ArmMode.REFLEX and "communication_constraints_violation" in state.errors
        assert rests(arm)
        with pytest.raises(HardwareError, match=r"recover\(\)"):
            arm.execute(turn(arm, 0.3 * TURN))
        arm.recover(timeout=5.0)
        assert arm.state().mode is ArmMode.IDLE and arm.state().errors == ()
        assert end_of(arm.execute(turn(arm, 0.3 * TURN))).reached


def test_a_jump_is_refused_before_it_is_sent_and_a_reflex_when_it_is_sent(strict: Peer):
    with arm_at(strict) as arm:
        smooth = turn(arm, 0.5 * TURN)
        q = smooth.q.copy()
        q[100:] += 0.05
        with pytest.raises(LimitViolation):
            arm.execute(type(smooth)(smooth.joint_names, smooth.dt, q, smooth.dq, smooth.ddq))
        assert rests(arm, 0.2)
        arm.process.orders.look()
        arm.process.running().send(Execute(99, q, smooth.dq, smooth.ddq, smooth.dt, np.full(7, 5.0), np.full(7, 500.0)))
        end = time.monotonic() + 5.0
        while arm.state().mode is not ArmMode.REFLEX:
            assert time.monotonic() < end
            time.sleep(0.05)
        assert any("discontinuity" in name or "violation" in name for name in arm.state().errors)
        arm.process.take(1.0)
        arm.recover(timeout=5.0)
        assert arm.state().mode is ArmMode.IDLE


def test_a_controller_that_dies_mid_motion_is_noticed_and_named():
    peer = PEERS["franka-sim"]()
    try:
        with arm_at(peer) as arm:
            motion = arm.execute(turn(arm, 3 * TURN, 3.0))
            until_moving(arm, motion)
            peer.close()
            start = time.monotonic()
            with pytest.raises(HardwareError, match=f"ping {peer.host}"):
                end_of(motion)
            assert time.monotonic() - start < DETECTED_S
            with pytest.raises(HardwareError, match="lost"):
                arm.recover(timeout=2.0)
            with pytest.raises(HardwareError, match="lost"):
                arm.execute(turn_of_nothing(arm))
    finally:
        peer.close()


def turn_of_nothing(arm: FciArm):
    from evg_app.types import Trajectory

    return Trajectory(arm.joint_names, 0.004, np.zeros((2, 7)), np.zeros((2, 7)), np.zeros((2, 7)))


OWNER = """
import sys
sys.path.insert(0, {folder!r})
from fci_motions import TURN, turn, until_moving
from fci_peers import robot_at, tool_pose_of
from evg_app.robots.fci.arm import FciArm
if __name__ == "__main__":
    robot = robot_at({host!r})
    with FciArm(robot, tool_pose_of(robot)) as arm:
        motion = arm.execute(turn(arm, -4 * TURN, 4.0))
        until_moving(arm, motion)
        sys.stdout.write("moving\\n")
        sys.stdout.flush()
        while motion.wait(0.02) is None:
            pass
"""


def test_when_the_application_is_killed_the_arm_brakes_and_holds(strict: Peer, tmp_path: Path):
    program = tmp_path / "owner.py"
    program.write_text(OWNER.format(folder=str(Path(__file__).parent), host=strict.host))
    root = Path(__file__).parents[3]
    with subprocess.Popen(
        [sys.executable, str(program)], stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(root)}
    ) as owner:
        assert owner.stdout is not None
        assert owner.stdout.readline() == b"moving\n"
        owner.kill()
        owner.wait()
    time.sleep(1.5)
    with arm_at(strict) as arm:
        state = arm.state()
        assert state.mode is ArmMode.IDLE and state.errors == () and rests(arm)


def test_the_strict_hand_stops_at_its_object(strict: Peer):
    with hand_at(strict) as hand:
        result = hand.grasp(0.0, 0.1, 30.0, 0.08, 0.08, 5.0)
        assert result.success and result.width == pytest.approx(OBJECT_WIDTH, abs=0.002)
        missed = hand.grasp(0.02, 0.1, 30.0, 0.005, 0.005, 5.0)
        assert not missed.success and "wanted 20.0 mm" in missed.message


def test_a_hand_is_stopped_in_the_middle_of_a_command():
    peer = PEERS["franky-sim"]()

    def interrupt(_signal: int, _frame: object) -> None:
        raise Stopped("now")

    previous = signal.signal(signal.SIGALRM, interrupt)
    try:
        with hand_at(peer) as hand:
            hand.move(0.08, 0.1, 10.0)
            signal.setitimer(signal.ITIMER_REAL, 0.3)
            with pytest.raises(Stopped):
                hand.move(0.0, 0.02, 30.0)
            hand.stop()
            width = hand.state().width
            time.sleep(0.5)
            assert 0.005 < hand.state().width == pytest.approx(width, abs=0.003)
            assert hand.move(0.06, 0.1, 10.0).success
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)
        peer.close()


def test_nobody_there_is_an_error_with_advice():
    robot = robot_at("127.77.0.1")
    with pytest.raises(HardwareError, match=r"127\.77\.0\.1"), FciArm(robot, tool_pose_of(robot)):
        pass
    with pytest.raises(HardwareError, match=r"127\.77\.0\.1"), FciGripper(robot):
        pass


def test_a_panda_is_recognised_by_its_protocol():
    """A controller that answers Connect as a Panda does: incompatible, version 5."""
    with socket.create_server(("127.77.0.2", 1337)) as server:

        def answer() -> None:
            client, _ = server.accept()
            with client:
                request = client.recv(64)
                command, number, _size = struct.unpack("<III", request[:12])
                client.sendall(struct.pack("<IIIBH", command, number, 15, 1, 5))
                time.sleep(0.2)

        thread = threading.Thread(target=answer)
        thread.start()
        robot = robot_at("127.77.0.2")
        with pytest.raises(HardwareError, match="Panda"), FciArm(robot, tool_pose_of(robot)):
            pass
        thread.join()
