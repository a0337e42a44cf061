"""Programs that speak the Franka network protocol, in processes and environments of their own."""

import importlib.util
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from evg_app.config.files import load_robot
from evg_app.config.models import RobotConfig
from evg_app.geometry import T_GRASP_TCP, T_HAND_GRASP, Array
from evg_app.motion.kinematics import Kinematics

ROOT = Path(__file__).resolve().parents[3]
START_TIMEOUT = 60.0
"""A peer must listen within this [s]; it compiles its model first."""
OBJECT_WIDTH = 0.04
"""franka-sim has something this wide between its fingers [m]."""
WRIST, STEADY_WRIST = 'armature="0.074"', 'armature="0.2"'
"""franka-sim's damping is too strong for the wrist of franky-sim's model: it would chatter at +-0.077 rad/s."""
_taken = 0


def free_address() -> str:
    """A loopback address that no other peer of this machine uses."""
    global _taken
    while True:
        _taken += 1
        number = (os.getpid() * 251 + _taken) % (250 * 250)
        address = f"127.77.{1 + number // 250}.{1 + number % 250}"
        with socket.socket() as probe:
            if probe.connect_ex((address, 1337)) != 0:
                return address


def robot_at(host: str, robot: str = "panda", **changes: object) -> RobotConfig:
    """A robot's config with the FCI at `host`."""
    config = load_robot(robot)
    fci = config.fci.model_copy(update={"host": host, "realtime": "ignore", **changes})
    return config.model_copy(update={"fci": fci})


def tool_pose_of(robot: RobotConfig):
    """T_base_tcp by our model."""
    kinematics = Kinematics(robot)

    def tool_pose(q: Array) -> Array:
        return kinematics.fk_hand(q) @ T_HAND_GRASP @ T_GRASP_TCP

    return tool_pose


class Peer:
    """A running peer."""

    def __init__(self, name: str, command: list[str], host: str, environment: dict[str, str] | None = None) -> None:
        self.name = name
        self.host, self._log = host, tempfile.TemporaryFile()  # noqa: SIM115
        self.process = subprocess.Popen(
            command,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env=os.environ | (environment or {}),
        )
        self._wait()

    def _wait(self) -> None:
        end = time.monotonic() + START_TIMEOUT
        while time.monotonic() < end:
            if self.process.poll() is not None:
                raise AssertionError(f"the peer ended: {self.log()[-2000:]}")
            with socket.socket() as probe:
                if probe.connect_ex((self.host, 1338)) == 0:
                    break
            time.sleep(0.1)
        else:
            raise AssertionError(f"the peer does not listen: {self.log()[-2000:]}")
        time.sleep(0.5)

    def log(self) -> str:
        """What it said so far."""
        self._log.seek(0)
        return self._log.read().decode(errors="replace")

    def signal(self, number: int) -> None:
        """Send a signal to it."""
        os.killpg(self.process.pid, number)

    def close(self) -> None:
        """End it."""
        if self.process.poll() is None:
            self.signal(signal.SIGKILL)
            self.process.wait()


def franky_sim() -> Peer:
    """The physics peer: no limits, no reflexes, fingers that move."""
    host = free_address()
    program = Path(sys.executable).with_name("franky-sim")
    assert program.exists(), "franky-sim is not installed. Run: ./setup.sh test"
    return Peer("franky-sim", [str(program), "-s", "mujoco", "--hostname", host], host)


def franka_sim(*words: str, object_width: float | None = OBJECT_WIDTH) -> Peer:
    """The strict peer: checks every command against the FR3's limits and counts lost packets."""
    host = free_address()
    python = ROOT / ".venv-franka-sim" / "bin" / "python"
    assert python.exists(), "franka-sim is not installed. Run: ./test.sh"
    command = [str(python), str(Path(__file__).with_name("franka_sim_peer.py")), "--host", host]
    held = [] if object_width is None else ["--object-width", str(object_width)]
    return Peer("franka-sim", [*command, *held, *words], host, {"FR3_MJCF": str(_model())})


def _model() -> Path:
    """franka-sim fetches its model from the network; it gets the one that franky-sim ships instead."""
    spec = importlib.util.find_spec("franky_sim")
    assert spec is not None and spec.origin is not None
    assets = Path(spec.origin).parent / "assets"
    folder = Path(tempfile.gettempdir()) / f"evg-fr3-steady-{os.getuid()}"
    if not (folder / "fr3.xml").exists():
        folder.mkdir(exist_ok=True)
        if not (folder / "assets").exists():
            (folder / "assets").symlink_to(assets / "meshes")
        text = (assets / "fr3.xml").read_text()
        hand = '<body name="hand" pos="0 0 0.107"'
        assert hand in text
        text = text.replace(hand, f'<body name="fr3_link8" pos="0 0 0.107"/>{hand}')
        assert WRIST in text
        (folder / "part").write_text(text.replace(WRIST, STEADY_WRIST))
        (folder / "part").rename(folder / "fr3.xml")
    return folder / "fr3.xml"


PEERS = {"franky-sim": franky_sim, "franka-sim": franka_sim}
