"""The arm's driver against real action servers in another process: what goes right, and every fault at the wire.

Each fault has a bounded time to detection, leaves the arm holding, and gives a message with the next command.
"""

import signal
import time

import numpy as np
import pytest
from ros2_peer import PeerProcess
from ros2_wire import TURN, configured, end_of, motion

from evg_app.config.files import load_robot
from evg_app.errors import DeviceTimeout, HardwareError, Refused
from evg_app.robots.ros2 import Ros2Robot, open_robot
from evg_app.types import ArmMode, Trajectory

pytestmark = pytest.mark.ros

GOAL_RAD = 0.02
HOLD_RAD = 2e-3
"""A holding arm moves less than this."""
BUSY_S = 1.0
"""What a busy computer may add to a detection."""


def holds(peer: PeerProcess) -> bool:
    """Whether the peer's arm stands still, in its own physics."""
    time.sleep(0.3)
    before = peer.ask("facts")["q"]
    time.sleep(0.3)
    return bool(np.abs(peer.ask("facts")["q"] - before).max() < HOLD_RAD)


def test_motion_reaches_its_goal_and_the_peer_agrees(robot: Ros2Robot, peer: PeerProcess):
    trajectory = motion(robot)
    result = end_of(robot.arm.execute(trajectory))
    assert result.reached and result.goal_error < GOAL_RAD
    assert np.abs(peer.ask("facts")["q"] - trajectory.q[-1]).max() < GOAL_RAD
    assert peer.wire("goal") == [f"{len(trajectory.q)} points"] and peer.wire("end") == ["reached"]


def test_cancel_reaches_the_wire_and_the_arm_holds_short_of_the_goal(robot: Ros2Robot, peer: PeerProcess):
    trajectory = motion(robot, 2 * TURN, 3.0)
    handle = robot.arm.execute(trajectory)
    assert handle.wait(1.0) is None
    handle.cancel()
    assert peer.wire("cancel") == ["/panda_arm_controller/follow_joint_trajectory"]
    result = end_of(handle)
    assert not result.reached and result.reason == "cancelled"
    assert holds(peer)
    assert np.abs(peer.ask("facts")["q"] - trajectory.q[-1]).max() > 0.05


def test_leaving_the_arm_cancels_its_motion_on_the_wire(peer: PeerProcess):
    opened = open_robot(load_robot("panda"))
    with opened.arm:
        opened.arm.execute(motion(opened, 2 * TURN, 3.0)).wait(0.5)
    assert len(peer.wire("cancel")) == 1
    assert holds(peer)


def test_rejected_goal_says_who_rejected_it_and_the_arm_can_move_afterwards(robot: Ros2Robot, peer: PeerProcess):
    peer.ask("fault", {"reject": True})
    with pytest.raises(HardwareError, match=r"follow_joint_trajectory rejected.*Run: ros2"):
        robot.arm.execute(motion(robot))
    assert holds(peer)
    peer.ask("fault", {})
    assert end_of(robot.arm.execute(motion(robot))).reached


def test_aborted_motion_gives_the_controllers_reason(robot: Ros2Robot, peer: PeerProcess):
    peer.ask("fault", {"abort_after": 0.5})
    result = end_of(robot.arm.execute(motion(robot)))
    assert not result.reached and result.reason.startswith("PATH_TOLERANCE_VIOLATED: ")
    assert holds(peer)
    peer.ask("fault", {})
    assert end_of(robot.arm.execute(motion(robot, 0.3 * TURN))).reached


def test_silent_server_is_given_up_in_time_and_its_late_answer_is_cancelled(robot: Ros2Robot, peer: PeerProcess):
    peer.ask("fault", {"silent": True})
    before = peer.ask("facts")["q"]
    start = time.monotonic()
    with pytest.raises(DeviceTimeout, match=r"follow_joint_trajectory to accept.*Run: ros2 launch"):
        robot.arm.execute(motion(robot))
    assert time.monotonic() - start < 2.0 + BUSY_S
    peer.ask("fault", {})
    time.sleep(0.5)
    assert len(peer.wire("cancel")) == 1
    assert holds(peer)
    assert np.abs(peer.ask("facts")["q"] - before).max() < 0.05


def test_frozen_controller_is_noticed_by_its_missing_feedback(robot: Ros2Robot, peer: PeerProcess):
    handle = robot.arm.execute(motion(robot, 2 * TURN, 3.0))
    assert handle.wait(0.5) is None
    peer.ask("fault", {"freeze": True})
    start = time.monotonic()
    with pytest.raises(DeviceTimeout, match=r"feedback of /panda_arm_controller.*ros2 control list_controllers"):
        end_of(handle)
    assert time.monotonic() - start < 1.0 + BUSY_S
    assert len(peer.wire("cancel")) == 1
    with pytest.raises(HardwareError, match="recover"):
        robot.arm.execute(motion(robot))
    peer.ask("fault", {})
    assert holds(peer)
    robot.arm.recover(3.0)
    assert end_of(robot.arm.execute(motion(robot, 0.3 * TURN))).reached


def test_late_joint_states_stop_the_motion(robot: Ros2Robot, peer: PeerProcess):
    handle = robot.arm.execute(motion(robot, 2 * TURN, 4.0))
    assert handle.wait(0.5) is None
    peer.ask("fault", {"late_joints": 1.5})
    start = time.monotonic()
    with pytest.raises(DeviceTimeout, match=r"/joint_states .*ros2 topic hz /joint_states"):
        end_of(handle)
    assert time.monotonic() - start < 0.5 + BUSY_S
    assert len(peer.wire("cancel")) == 1
    assert holds(peer)


def test_joint_states_that_come_but_are_old_count_as_stale(robot: Ros2Robot, peer: PeerProcess):
    robot.arm.state()
    peer.ask("fault", {"late_joints": 1.0})
    time.sleep(1.6)
    with pytest.raises(DeviceTimeout, match=r"/joint_states \(last one"):
        robot.arm.state()


def test_peer_that_dies_in_mid_motion_is_noticed(own_peer: PeerProcess):
    opened = open_robot(load_robot("panda"))
    with opened.arm:
        handle = opened.arm.execute(motion(opened, 2 * TURN, 4.0))
        assert handle.wait(0.5) is None
        own_peer.kill()
        start = time.monotonic()
        # All topics end at once; which of the two is found stale first is chance.
        with pytest.raises(DeviceTimeout, match=r"waiting for \S*/(joint_states|robot_state) .*Run: ros2 launch"):
            end_of(handle)
        assert time.monotonic() - start < 0.5 + 1.0 + BUSY_S
        with pytest.raises(HardwareError):
            opened.arm.recover(1.0)


def test_reflex_is_reported_and_recovered_in_three_ordered_steps(robot: Ros2Robot, peer: PeerProcess):
    handle = robot.arm.execute(motion(robot, 2 * TURN, 3.0))
    assert handle.wait(0.5) is None
    peer.ask("reflex")
    result = end_of(handle)
    assert not result.reached and "reflex" in result.reason
    state = robot.arm.state()
    assert state.mode is ArmMode.REFLEX and state.errors == ("cartesian_reflex",)
    with pytest.raises(HardwareError, match="cartesian_reflex"):
        robot.arm.execute(motion(robot))
    before = peer.ask("facts")["q"]
    robot.arm.recover(10.0)
    steps = [kind for _, kind, _ in peer.ask("facts")["wire"] if kind in ("error_recovery", "set_hardware", "switch")]
    assert steps == ["error_recovery", "set_hardware", "switch"]
    assert peer.wire("set_hardware") == ["FrankaHardwareInterface active 3"]
    assert np.abs(peer.ask("facts")["q"] - before).max() < HOLD_RAD, "recovery must not move the arm"
    assert end_of(robot.arm.execute(motion(robot, 0.3 * TURN))).reached


def test_controllers_that_somebody_stopped_are_started_by_recovery(robot: Ros2Robot, peer: PeerProcess):
    peer.ask("deactivate")
    time.sleep(0.3)
    with pytest.raises(HardwareError, match="rejected"):
        robot.arm.execute(motion(robot))
    robot.arm.recover(10.0)
    assert "panda_arm_controller" in peer.wire("switch")[0]
    assert end_of(robot.arm.execute(motion(robot, 0.3 * TURN))).reached


def test_refused_recovery_names_its_step(robot: Ros2Robot, peer: PeerProcess):
    peer.ask("fault", {"refuse_recovery": True})
    peer.ask("reflex")
    with pytest.raises(HardwareError, match=r"recovery step 1 \(/action_server/error_recovery\)"):
        robot.arm.recover(5.0)


def test_user_stop_is_not_recovered_from(robot: Ros2Robot, peer: PeerProcess):
    peer.ask("mode", 5)
    time.sleep(0.3)
    assert robot.arm.state().mode is ArmMode.USER_STOPPED
    with pytest.raises(HardwareError, match="user stop"):
        robot.arm.recover(3.0)
    assert peer.wire("error_recovery") == []


def test_trajectory_that_starts_elsewhere_never_leaves(robot: Ros2Robot, peer: PeerProcess):
    here = motion(robot)
    with pytest.raises(Refused):
        robot.arm.execute(Trajectory(here.joint_names, here.dt, here.q + 0.1, here.dq, here.ddq))
    assert peer.wire("goal") == []


def test_peer_refuses_joints_in_another_order(peer: PeerProcess):
    names = load_robot("panda").joints
    opened = open_robot(configured(joints=(names[1], names[0], *names[2:])))
    with opened.arm, pytest.raises(HardwareError, match="rejected"):
        opened.arm.execute(motion(opened))
    assert "in this order" in peer.wire("reject")[0]


def test_peer_refuses_a_start_with_velocity(robot: Ros2Robot, peer: PeerProcess):
    here = motion(robot)
    moving = here.dq.copy()
    moving[0] = 0.1
    with pytest.raises(HardwareError, match="rejected"):
        robot.arm.execute(Trajectory(here.joint_names, here.dt, here.q, moving, here.ddq))
    assert peer.wire("reject") == ["it starts with a velocity"]


def test_peer_refuses_time_that_stands_or_goes_back(robot: Ros2Robot, peer: PeerProcess):
    here = motion(robot)
    for dt in (0.0, -0.01):
        with pytest.raises(HardwareError, match="rejected"):
            robot.arm.execute(Trajectory(here.joint_names, dt, here.q, here.dq, here.ddq))
    assert peer.wire("reject") == ["time does not go forward"] * 2


def test_missing_controller_is_named_with_the_command_that_starts_it(peer: PeerProcess):
    opened = open_robot(configured(arm_action="/other_controller/follow_joint_trajectory", server_timeout_s=1.0))
    start = time.monotonic()
    with pytest.raises(HardwareError, match=r"not there after 1 s: /other_controller.*peer.*Run: ros2 launch"):
        opened.arm.__enter__()
    assert time.monotonic() - start < 1.0 + 2 * BUSY_S
    assert not opened.link.alive


def test_force_comes_in_newton_and_torque_in_newton_metre(robot: Ros2Robot, peer: PeerProcess):
    peer.ask("fault", {"wrench": [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]})
    time.sleep(0.3)
    assert robot.arm.state().wrench == pytest.approx([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])


def test_without_control_msgs_the_topic_moves_and_brakes_the_arm_and_says_what_is_lost(peer: PeerProcess):
    opened = open_robot(load_robot("panda"), use_topic=True)
    with opened.arm:
        assert any("nobody accepts or rejects" in note for note in opened.arm.warnings)
        assert end_of(opened.arm.execute(motion(opened))).reached
        handle = opened.arm.execute(motion(opened, -2 * TURN, 3.0))
        assert handle.wait(1.0) is None
        handle.cancel()
        assert end_of(handle).reason == "cancelled"
        assert holds(peer)
    assert peer.wire("goal") == [] and len(peer.wire("topic")) == 3


def test_ctrl_c_stays_with_the_application(robot: Ros2Robot):
    assert signal.getsignal(signal.SIGINT) in (signal.default_int_handler, signal.SIG_IGN)  # ignored in the background


def test_anybody_may_stop_the_run_over_a_topic(robot: Ros2Robot):
    from std_msgs.msg import Empty

    asked = []
    with robot.listening_for_stop(lambda: asked.append(True)):
        publisher = robot.link.call(lambda: robot.link.node.create_publisher(Empty, "/evg_app/stop", 1), "a publisher")
        assert robot.link.wait_until(lambda: publisher.get_subscription_count() > 0, 2.0)
        robot.link.call(lambda: publisher.publish(Empty()), "a stop")
        assert robot.link.wait_until(lambda: bool(asked), 2.0)
