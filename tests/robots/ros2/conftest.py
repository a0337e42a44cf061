"""A peer process for all tests, brought home before each; the driver under test on the other side of the wire."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / "peer"))

from ros2_peer import PeerProcess, fresh_domain, shared_peer

from evg_app.config.files import load_robot
from evg_app.robots.ros2 import Ros2Robot, open_robot


@pytest.fixture(scope="session")
def running() -> PeerProcess:
    return shared_peer()


@pytest.fixture
def peer(running: PeerProcess) -> PeerProcess:
    running.ask("home")
    return running


@pytest.fixture
def own_peer(monkeypatch: pytest.MonkeyPatch) -> Iterator[PeerProcess]:
    """A peer that a test may kill, alone on its domain."""
    monkeypatch.setenv("ROS_DOMAIN_ID", fresh_domain())
    peer = PeerProcess()
    yield peer
    peer.close()


@pytest.fixture
def robot(peer: PeerProcess) -> Iterator[Ros2Robot]:
    opened = open_robot(load_robot("panda"))
    with opened.arm, opened.gripper:
        yield opened
