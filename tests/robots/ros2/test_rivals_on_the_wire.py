"""Two robots behind the same names: nothing is sent, and an arm that died is not taken for one that came after it."""

import time
from collections.abc import Iterator

import numpy as np
import pytest
from ros2_peer import PeerProcess
from ros2_wire import TURN, end_of, motion

from evg_app.config.files import load_robot
from evg_app.errors import DeviceTimeout, HardwareError
from evg_app.robots.guard import GuardedArm
from evg_app.robots.ros2 import Ros2Robot, open_robot, rivals
from evg_app.robots.ros2.survey import survey

pytestmark = pytest.mark.ros

SEEN_S = 10.0
"""A new robot is seen within this, on a busy machine."""


@pytest.fixture
def second(own_peer: PeerProcess) -> Iterator[list[PeerProcess]]:
    """Start one with `second.append(PeerProcess())`; they are ended afterwards."""
    peers: list[PeerProcess] = []
    yield peers
    for peer in peers:
        peer.close()


def seen(link, action: str, count: int) -> bool:
    return link.wait_until(lambda: rivals.servers(link, action) == count, SEEN_S)


def heard(opened: Ros2Robot) -> bool:
    """Whether the state comes again."""
    try:
        opened.arm.state()
    except DeviceTimeout:
        return False
    return True


def test_a_second_robot_that_turns_up_on_the_domain_gets_no_goal(own_peer: PeerProcess, second: list[PeerProcess]):
    opened = open_robot(load_robot("panda"))
    with opened.arm:
        second.append(PeerProcess())
        assert seen(opened.link, load_robot("panda").ros2.arm_action, 2)
        start = time.monotonic()
        with pytest.raises(HardwareError, match=r"2 servers of .*Nothing was sent.*export ROS_DOMAIN_ID"):
            opened.arm.execute(motion(opened))
        assert time.monotonic() - start < 1.0
    assert own_peer.wire("goal") == [] and second[0].wire("goal") == []


def test_two_robots_at_connect_are_refused_and_the_check_says_so(
    own_peer: PeerProcess, second: list[PeerProcess], monkeypatch: pytest.MonkeyPatch
):
    second.append(PeerProcess())
    monkeypatch.setattr("evg_app.robots.ros2.device.LEASE_S", 1.0)
    opened, action = open_robot(load_robot("panda")), load_robot("panda").ros2.arm_action
    opened.link.acquire()
    try:
        assert seen(opened.link, action, 2)
        for device in (opened.arm, opened.gripper):
            with pytest.raises(HardwareError, match=r"2 servers of .*export ROS_DOMAIN_ID"):
                device.__enter__()
    finally:
        opened.link.release()
    found = survey(load_robot("panda"), 5.0)
    assert not found.complete and any("2 servers of " + action in line for line in found.lines)


def test_a_robot_that_comes_back_after_its_death_moves_only_when_a_person_agrees(
    own_peer: PeerProcess, second: list[PeerProcess]
):
    opened, answers = open_robot(load_robot("panda")), [False, True]
    arms = [
        GuardedArm(opened.arm, lambda q: np.zeros((len(q), 3)), None, acknowledge=lambda question: answers.pop(0))
        for _ in answers
    ]
    with opened.arm:
        handle = arms[0].execute(motion(opened, 2 * TURN, 4.0))
        assert handle.wait(0.5) is None
        own_peer.kill()
        with pytest.raises(HardwareError, match="Run: ros2 launch"):
            end_of(handle)
        second.append(PeerProcess())
        with pytest.raises(HardwareError, match="nobody let it go on; it holds"):
            arms[0].recover(1.0)
        assert second[0].wire("goal") == []
        assert opened.link.wait_until(lambda: heard(opened), SEEN_S)
        arms[1].recover(rivals.LEASE_S + SEEN_S)
        assert end_of(arms[1].execute(motion(opened, 0.3 * TURN))).reached
