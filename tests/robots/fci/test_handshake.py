"""At connect: hand, tool, load and model must agree; what cannot be corrected is refused."""

from dataclasses import replace

import numpy as np
import pytest

from evg_app.config.files import load_robot
from evg_app.errors import Refused
from evg_app.geometry import invert, translation
from evg_app.robots.fci import handshake
from evg_app.robots.fci.messages import Facts

ROBOT = load_robot("panda")
TOOL = handshake.expected_tool(ROBOT)
FLANGE = translation(0.5, 0.1, 0.4)


def tool_pose(q):
    return FLANGE @ TOOL


def facts(**changes) -> Facts:
    good = Facts("0", np.zeros(7), TOOL, np.eye(4), TOOL, FLANGE @ TOOL, 0.73, 0.0, (), "")
    return replace(good, **changes)


def test_a_controller_that_agrees_needs_nothing():
    assert handshake.configuration(ROBOT, facts()).NE_T_EE is None
    assert handshake.differences(ROBOT, facts(), facts(), tool_pose) == []


def test_a_wrong_end_effector_frame_is_set_and_said():
    before = facts(F_T_NE=np.eye(4), F_T_EE=np.eye(4), O_T_EE=FLANGE)
    wanted = handshake.configuration(ROBOT, before).NE_T_EE
    np.testing.assert_allclose(wanted, TOOL)
    (said,) = handshake.differences(ROBOT, before, facts(), tool_pose)
    assert not said.fault and "is set now" in said.text and "103.4 mm" in said.text


def test_a_frame_that_the_controller_does_not_take_is_refused():
    other = facts(F_T_EE=TOOL @ translation(0, 0, 0.01), O_T_EE=FLANGE @ TOOL @ translation(0, 0, 0.01))
    found = handshake.differences(ROBOT, other, other, tool_pose)
    with pytest.raises(Refused, match="Desk"):
        handshake.require(found)


def test_another_arm_than_the_config_describes_is_refused():
    moved = facts(O_T_EE=translation(0, 0, 0.05) @ FLANGE @ TOOL)
    with pytest.raises(Refused, match="right robot config"):
        handshake.require(handshake.differences(ROBOT, moved, moved, tool_pose))


def test_a_hand_that_desk_does_not_know_is_a_warning():
    warnings = handshake.require(handshake.differences(ROBOT, facts(), facts(m_ee=0.0), tool_pose))
    assert len(warnings) == 1 and "Franka Hand" in warnings[0]


def test_a_load_that_the_controller_keeps_is_refused():
    with pytest.raises(Refused, match=r"load of 0\.50 kg"):
        handshake.require(handshake.differences(ROBOT, facts(), facts(m_load=0.5), tool_pose))


def test_our_tool_is_the_tcp_of_our_model():
    from fci_peers import tool_pose_of

    from evg_app.motion.kinematics import Kinematics

    q = np.array(ROBOT.home_q_rad)
    frames = Kinematics(ROBOT).frames(q[None])[0]
    flange = frames[7] @ translation(0, 0, 0.107)
    np.testing.assert_allclose(invert(flange) @ tool_pose_of(ROBOT)(q), TOOL, atol=1e-6)
