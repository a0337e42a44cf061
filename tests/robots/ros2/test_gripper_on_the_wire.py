"""The gripper's driver against franka_gripper's actions in another process."""

import threading
import time

import pytest
from ros2_peer import PeerProcess
from ros2_wire import configured

from evg_app.config.files import load_robot
from evg_app.errors import DeviceTimeout, HardwareError
from evg_app.robots.ros2 import Ros2Robot, open_robot

pytestmark = pytest.mark.ros

WIDTH_M = 0.002
BUSY_S = 1.0


def test_grasp_sends_width_zero_and_the_force_and_reports_where_the_fingers_stopped(
    robot: Ros2Robot, peer: PeerProcess
):
    result = robot.gripper.grasp(0.0, 0.1, 25.0, 0.08, 0.08, timeout=5.0)
    assert result.success and result.width < WIDTH_M
    assert peer.wire("grasp") == ["0.0000 25.0"]
    assert not robot.gripper.state().is_grasped, "closed fingers hold nothing"


def test_device_verdict_and_width_are_kept_apart(robot: Ros2Robot, peer: PeerProcess):
    peer.ask("fault", {"lying_gripper": True})
    result = robot.gripper.grasp(0.0, 0.1, 30.0, 0.08, 0.08, timeout=5.0)
    assert not result.success and result.message == "not in the window" and result.width < WIDTH_M


def test_silent_gripper_is_given_up_in_time_and_cancelled_on_the_wire(robot: Ros2Robot, peer: PeerProcess):
    peer.ask("fault", {"silent_gripper": True})
    start = time.monotonic()
    with pytest.raises(DeviceTimeout, match=r"/franka_gripper/grasp to end.*Run: ros2 launch franka_gripper"):
        robot.gripper.grasp(0.0, 0.1, 30.0, 0.08, 0.08, timeout=1.0)
    assert time.monotonic() - start < 1.0 + BUSY_S
    assert peer.wire("cancel") == ["/franka_gripper/grasp"]


def test_stop_cancels_and_calls_the_stop_service(robot: Ros2Robot, peer: PeerProcess):
    peer.ask("fault", {"silent_gripper": True})
    command = threading.Thread(target=lambda: robot.gripper.move(0.02, 0.02, timeout=10.0))
    command.start()
    time.sleep(0.5)
    robot.gripper.stop()
    command.join(timeout=5.0)
    assert not command.is_alive()
    assert peer.wire("gripper stop") == [""] and peer.wire("cancel") == ["/franka_gripper/move"]


def test_mute_fingers_are_stale(robot: Ros2Robot, peer: PeerProcess):
    peer.ask("fault", {"mute_fingers": True})
    time.sleep(1.2)
    with pytest.raises(DeviceTimeout, match=r"/franka_gripper/joint_states"):
        robot.gripper.state()


def test_missing_gripper_is_named_with_the_command_that_starts_it(peer: PeerProcess):
    config = load_robot("panda").ros2
    assert config is not None
    names = config.gripper.model_copy(update={"grasp_action": "/nobody/grasp"})
    opened = open_robot(configured(gripper=names, server_timeout_s=1.0))
    with pytest.raises(HardwareError, match=r"/nobody/grasp.*fake hardware.*Run: ros2 launch franka_gripper"):
        opened.gripper.__enter__()
    assert not opened.link.alive


def test_gripper_command_counts_one_finger_and_closes_with_effort(peer: PeerProcess):
    config = load_robot("panda").ros2
    assert config is not None
    opened = open_robot(configured(gripper=config.gripper.model_copy(update={"kind": "gripper_command"})))
    with opened.gripper:
        moved = opened.gripper.move(0.03, 0.1, timeout=5.0)
        assert moved.success and moved.width == pytest.approx(0.03, abs=WIDTH_M)
        closed = opened.gripper.grasp(0.0, 0.1, 30.0, 0.08, 0.08, timeout=5.0)
        assert closed.success and closed.width < WIDTH_M
        opened.gripper.stop()
    assert peer.wire("grippercommand") == ["0.0300 20.0", "0.0000 30.0"]
