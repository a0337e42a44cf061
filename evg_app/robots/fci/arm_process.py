"""The streaming process seen from the application: connected, configured, asked, listened to."""

import time
from collections.abc import Callable

from evg_app.config.models import RobotConfig
from evg_app.errors import HardwareError, MissingExtra
from evg_app.robots.fci import handshake, realtime, versions
from evg_app.robots.fci.messages import Done, Ended, Facts, Failed, Leave
from evg_app.robots.fci.shared import Orders, StateBlock
from evg_app.robots.fci.streamer import Options, main
from evg_app.robots.fci.worker import Worker

CONNECT_TIMEOUT = 30.0
"""The controller must answer within this [s]."""
CONFIGURE_TIMEOUT = 3.0
"""It must take frames and thresholds within this [s]."""
TAKE_TIMEOUT = 1.0
"""Frames that were set must show in the controller's states within this [s]."""
TAKES = "the controller to take frames and thresholds"


class ArmProcess:
    """The process that owns the connection to the arm.

    Args:
        robot: its config; `fci` says how to connect.
        ended: told when a motion ended, while somebody waits here.

    Attributes:
        block, orders: the memory that is shared with it.
        facts: what the controller said at connect, None before.
        broken: why nothing can be asked any more, empty while the connection stands.
    """

    def __init__(self, robot: RobotConfig, ended: Callable[[Ended], None]) -> None:
        self._robot, self._ended = robot, ended
        self.block, self.orders = StateBlock(), Orders()
        self._worker: Worker | None = None
        self.facts: Facts | None = None
        self.broken = ""

    def connect(self, tool_pose: handshake.ToolPose) -> tuple[str, ...]:
        """Start it, configure the controller and compare it with our model; what a person should know.

        Raises:
            MissingExtra: pylibfranka is not installed.
            HardwareError: no connection, with what to do about it.
            Refused: the controller's frames or load cannot be brought to ours.
        """
        fci = self._robot.fci
        options = Options(fci.host, fci.realtime, fci.priority, fci.core, fci.look_away_s)
        self.broken = ""
        self._worker = Worker("arm", main, (self.block, self.orders, options), Leave())
        before = self._told(CONNECT_TIMEOUT, f"the robot at {fci.host} to answer")
        self._worker.send(handshake.configuration(self._robot, before))
        self.facts = self._told(CONFIGURE_TIMEOUT, TAKES)
        warnings = handshake.require(self._differences(before, self.facts, tool_pose))
        if fci.arm == "fer":
            text = f"the arm is an FR3, robot '{self._robot.name}' is configured as a Panda (fci.arm: fer)"
            warnings += (f"{text}: every motion is checked against the FR3's limits as well",)
        found = realtime.machine()
        if fci.realtime != "ignore":
            realtime.leave_core(found, fci.core)
        return warnings + tuple(realtime.advice(found))

    def _differences(self, before: Facts, now: Facts, tool_pose: handshake.ToolPose) -> list[handshake.Finding]:
        """What differs from our model once the controller has taken the configuration."""
        end = time.monotonic() + TAKE_TIMEOUT
        while True:
            found = handshake.differences(self._robot, before, now, tool_pose)
            if time.monotonic() > end or not any(f.fault for f in found):
                return found
            self.running().send(handshake.configuration(self._robot, now))
            now = self.facts = self._told(CONFIGURE_TIMEOUT, TAKES)

    def _told(self, timeout: float, what: str) -> Facts:
        """The facts that the process answers with."""
        host = self._robot.fci.host
        answer = self.running().wait(what, timeout, versions.connect_advice("", "timeout: imeout", host))
        if isinstance(answer, Done) and answer.facts is not None:
            return answer.facts
        if isinstance(answer, Failed):
            if answer.kind == "ImportError":
                raise MissingExtra("pylibfranka", "franka")
            advice = versions.connect_advice(answer.kind, answer.text, host)
            raise HardwareError(f"no connection to the robot at {host}: {answer.text} {advice}")
        raise HardwareError(f"unexpected answer of the arm process: {answer}")

    def running(self) -> Worker:
        """The process.

        Raises:
            HardwareError: it was not started.
        """
        if self._worker is None:
            raise HardwareError("the arm is not connected; enter it first")
        return self._worker

    @property
    def started(self) -> bool:
        """Whether there is a process."""
        return self._worker is not None

    def leave(self) -> None:
        """End it; may be called twice."""
        if self._worker is not None:
            self._worker.end()
            self._worker = None

    def require_link(self) -> None:
        """Pass while the connection stands.

        Raises:
            HardwareError: why it does not.
        """
        if self.broken:
            raise HardwareError(self.broken)

    def request(self, request: object, wanted: type, what: str, timeout: float) -> object:
        """Send a request and wait for its answer or `Failed`; the end of a motion may come in between.

        Raises:
            DeviceTimeout: no answer within `timeout` [s].
            HardwareError: the process is gone.
        """
        worker, end = self.running(), time.monotonic() + timeout
        worker.send(request)
        while True:
            answer = worker.wait(what, max(end - time.monotonic(), 0.0), "Look at Desk for an error.")
            if isinstance(answer, Failed):
                self._failed(answer)
            if isinstance(answer, wanted | Failed):
                return answer
            if isinstance(answer, Ended):
                self._ended(answer)

    def take(self, timeout: float) -> None:
        """Take what the process has to say, waiting at most `timeout` [s] for the first."""
        if self._worker is None or self.broken:
            return
        try:
            message = self._worker.poll(timeout)
            while message is not None:
                if isinstance(message, Ended):
                    self._ended(message)
                elif isinstance(message, Failed):
                    self._failed(message)
                message = self._worker.poll(0.0)
        except HardwareError as error:
            self.broken = self.broken or str(error)

    def _failed(self, failed: Failed) -> None:
        """Remember a connection that is lost."""
        if failed.kind == "NetworkException":
            host = self._robot.fci.host
            self.broken = (
                f"the connection to the robot at {host} is lost: {failed.text} The controller stops the arm by itself. "
                f"Run: ping {host}, look at Desk, then run the command again"
            )
