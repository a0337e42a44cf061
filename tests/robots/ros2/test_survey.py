"""`evg-app ros check` against the peer, and against nobody."""

import pytest
from ros2_peer import PeerProcess
from ros2_wire import configured

from evg_app.config.files import load_robot
from evg_app.robots.ros2.survey import survey, wanted

pytestmark = pytest.mark.ros


def test_everything_that_the_config_names_is_found(peer: PeerProcess):
    found = survey(load_robot("panda"), 10.0)
    assert found.complete, "\n".join(found.lines)
    assert any(line.startswith("nodes") and "peer" in line for line in found.lines)
    assert "ROS_DOMAIN_ID" in found.lines[0] and "LOCALHOST" in found.lines[0]


def test_what_is_missing_is_named_with_the_commands_that_start_it(peer: PeerProcess):
    robot = configured(arm_action="/nobody/follow_joint_trajectory")
    found = survey(robot, 1.0)
    assert not found.complete
    assert any(line.startswith("FAULT") and "/nobody/follow_joint_trajectory" in line for line in found.lines)
    assert robot.ros2 is not None and robot.ros2.start_arm in found.lines[-1]


def test_every_name_of_the_config_is_looked_for():
    config = load_robot("panda").ros2
    assert config is not None and config.recovery is not None
    names = wanted(config)
    assert {config.arm_action, config.robot_state, config.gripper.stop_service} <= set(names)
    assert {config.recovery.switch_service, config.recovery.error_recovery_action} <= set(names)
