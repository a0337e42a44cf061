"""The test's end of the peer: starts it, talks to it beside ROS, and makes sure that it is gone afterwards."""

import atexit
import functools
import itertools
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from multiprocessing.connection import Client
from pathlib import Path

from evg_app.robots.ros2.interfaces import build_folder, site_packages

START_S = 180.0


def isolate() -> None:
    """This process and its peers on a domain of their own, seen by this computer only."""
    if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") != "LOCALHOST" or "ROS_DOMAIN_ID" not in os.environ:
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randint(1, 100))


def fresh_domain() -> str:
    """A domain that no test of this process was on: whoever died on another is still in sight there for 20 s."""
    isolate()
    return str(1 + (int(os.environ["ROS_DOMAIN_ID"]) + next(_used)) % 100)


_used = itertools.count(1)


@functools.cache
def shared_peer() -> "PeerProcess":
    """The one peer of this process's domain."""
    isolate()
    peer = PeerProcess()
    atexit.register(peer.close)
    return peer


class PeerProcess:
    """One peer process; `stderr` holds what it said."""

    def __init__(self, *options: str) -> None:
        self.folder = tempfile.TemporaryDirectory(prefix="evg-peer-")
        self.socket = f"{self.folder.name}/s"
        self.errors = Path(self.folder.name) / "stderr"
        built = build_folder()
        environment = dict(os.environ)
        for name, value in (("PYTHONPATH", str(site_packages(built))), ("LD_LIBRARY_PATH", str(built / "lib"))):
            environment[name] = os.pathsep.join(part for part in (environment.get(name), value) if part)
        command = [sys.executable, str(Path(__file__).with_name("main.py")), "--socket", self.socket, *options]
        with self.errors.open("wb") as stream:
            self.process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=stream)
        self.connection = self._connect()
        self.ask("facts")

    def _connect(self):
        end = time.monotonic() + START_S
        while time.monotonic() < end and self.process.poll() is None:
            try:
                return Client(self.socket, "AF_UNIX")
            except (FileNotFoundError, ConnectionRefusedError):
                time.sleep(0.05)
        raise RuntimeError(f"the peer did not start: {self.errors.read_text()[-2000:]}")

    def ask(self, *request):
        self.connection.send(request)
        if not self.connection.poll(60.0):
            raise RuntimeError(f"the peer is silent: {self.errors.read_text()[-2000:]}")
        good, value = self.connection.recv()
        if not good:
            raise RuntimeError(value)
        return value

    def wire(self, what: str) -> list[str]:
        """Details of everything of that kind that reached the peer."""
        return [detail for _, kind, detail in self.ask("facts")["wire"] if kind == what]

    def kill(self) -> None:
        """As a crash or a pulled plug."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.connection.close()
        self.folder.cleanup()
