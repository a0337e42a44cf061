"""`evg-app run --driver fci` while the wire misbehaves: noticed in time, the arm holds, a message, a complete row.

The command runs on stored frames against franka-sim. Nobody sits at the terminal: every question is a no.
"""

import multiprocessing
import os
import re
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

from fci_motions import rests
from fci_peers import PEERS, Peer, robot_at, tool_pose_of
from injected import Injection, close_terminal, complete, ended, interrupt_twice, rows, run, terminate
from lab_files import lab_files

from evg_app.robots.fci.arm import FciArm
from evg_app.types import ArmMode

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

BUSY_S = 1.5
"""What a busy computer may add to a detection."""


def child(name: str) -> int:
    """The process id of the arm's or the hand's process."""
    (pid,) = [process.pid for process in multiprocessing.active_children() if process.name == f"evg-{name}"]
    assert pid is not None
    return pid


def lose_packets(peer: Peer, folder: Path) -> None:
    """What the streaming process should send meanwhile is lost."""
    pid = child("arm")
    os.kill(pid, signal.SIGSTOP)
    time.sleep(0.15)
    os.kill(pid, signal.SIGCONT)


def killed(name: str) -> Callable[[Peer, Path], None]:
    return lambda peer, folder: os.kill(child(name), signal.SIGKILL)


@dataclass(frozen=True)
class Fault:
    """One fault and what must come of it; `lives` is False when the peer is gone afterwards."""

    hurt: Callable[[Peer, Path], object]
    bound: float
    said: str
    code: int = 4
    lives: bool = True


FAULTS = {
    "controller dies": Fault(lambda peer, at: peer.close(), 1.5, r"connection .* is lost.*Run: ping", lives=False),
    "packets lost": Fault(lose_packets, 1.0, "communication_constraints_violation"),
    "streaming process killed": Fault(killed("arm"), 1.0, "process ended unexpectedly.*Run the command again"),
    "kill": Fault(lambda peer, at: terminate(), 0.5, "stopped", code=130),
    "terminal closed": Fault(lambda peer, at: close_terminal(), 0.5, "stopped", code=130),
    "Ctrl-C twice": Fault(lambda peer, at: interrupt_twice(), 0.5, "stopped", code=130),
    "stop file": Fault(lambda peer, at: (at / "STOP").touch(), 0.5, "stopped", code=130),
}


def arm_rests(peer: Peer) -> bool:
    """Whether the arm, asked by a new client, stays where it is."""
    robot = robot_at(peer.host)
    with FciArm(robot, tool_pose_of(robot)) as arm:
        return arm.state().mode is not ArmMode.MOVING and rests(arm)


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lab")
    lab_files(folder)
    return folder


@pytest.mark.parametrize("name", FAULTS)
def test_fault_in_a_run_is_noticed_in_time_the_arm_holds_and_the_log_is_complete(
    name: str, frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], record_property
):
    given, folder, peer = FAULTS[name], tmp_path / "run", PEERS["franka-sim"]()
    try:
        words = ["--robot", "panda", "--driver", "fci", "--host", peer.host, "--model", "antipodal"]
        words += ["--camera", f"replay/{frames / 'frames'}", "--config-dir", str(frames), "--confirm-speed", "0.3"]
        injection = Injection("look", lambda: given.hurt(peer, folder), delay=1.0)
        assert run(words, folder, injection) == given.code
        record_property("seconds", injection.seconds)
        assert injection.seconds < given.bound + BUSY_S
        assert injection.moved_on == []
        assert not given.lives or arm_rests(peer)
    finally:
        peer.close()
    said = capsys.readouterr()
    assert re.search(given.said, injection.said + said.out + said.err, re.DOTALL), injection.said
    logged = rows(folder)
    assert logged and all(complete(row) for row in logged)
    status, detail = ended(folder)
    if given.code == 130:
        assert status == "stopped by the user" and logged[-1]["outcome"] == "abandoned"
    else:
        assert status == "error" and detail in said.err and "run the command again" in detail
