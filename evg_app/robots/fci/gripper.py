"""The Franka Hand over the Franka Control Interface: a `robots.protocol.Gripper` in front of the hand process."""

from types import TracebackType
from typing import Self

from evg_app.config.models import RobotConfig
from evg_app.errors import DeviceTimeout, HardwareError, MissingExtra
from evg_app.identity import installed
from evg_app.robots.fci.hand import main
from evg_app.robots.fci.messages import Failed, Grip, Gripped, Leave
from evg_app.robots.fci.versions import connect_advice
from evg_app.robots.fci.worker import Worker
from evg_app.types import GripperResult, GripperState

CONNECT_TIMEOUT = 30.0
"""The hand must answer within this [s]."""
READ_TIMEOUT = 2.0
"""A reading must come within this [s]."""
QUICK_END_S = 0.2
"""A hand process that a command blocks is given this long to leave before it is ended [s]."""


class FciGripper:
    """A Franka Hand without ROS."""

    def __init__(self, robot: RobotConfig) -> None:
        self._host, self._max_width = robot.fci.host, robot.gripper.max_width_m
        self._worker: Worker | None = None
        self._busy = False
        self._first: Gripped | None = None

    def __enter__(self) -> Self:
        try:
            self._connect()
        except BaseException:
            self._leave()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._leave()

    def _connect(self) -> None:
        """Start the hand's process and wait for its first reading."""
        self._worker = Worker("hand", main, (self._host,), Leave())
        self._busy = False
        self._first = self._answer("the hand to answer", CONNECT_TIMEOUT)

    @property
    def identity(self) -> dict[str, str]:
        """Library, protocol and widest opening that the hand states."""
        told = {"driver": "fci", "host": self._host, "pylibfranka": installed("pylibfranka")}
        if self._first is None:
            return told
        return told | {"server version": str(self._first.server), "max width [m]": f"{self._first.max_width:.4f}"}

    @property
    def needs_homing(self) -> bool:
        """Whether the hand does not know its widest opening yet: its fingers were never homed since power-on."""
        return self._first is not None and self._first.max_width < 0.75 * self._max_width

    def _leave(self) -> None:
        """End the process; a command that blocks it is not waited for."""
        if self._worker is not None:
            self._worker.end(QUICK_END_S if self._busy else 3.0)
            self._worker = None

    def _answer(self, what: str, timeout: float) -> Gripped:
        """What the hand says, or why it cannot: named `what`, within `timeout` [s]."""
        if self._worker is None:
            raise HardwareError("the hand is not connected; enter it first")
        advice = "Is the hand plugged in and set as end effector in Desk?"
        answer = self._worker.wait(what, timeout, advice)
        self._busy = False
        if isinstance(answer, Gripped):
            return answer
        if isinstance(answer, Failed) and answer.kind == "ImportError":
            raise MissingExtra("pylibfranka", "franka")
        text = answer.text if isinstance(answer, Failed) else str(answer)
        kind = answer.kind if isinstance(answer, Failed) else ""
        raise HardwareError(
            f"no connection to the hand at {self._host}: {text} {connect_advice(kind, text, self._host)}"
        )

    def _ask(self, request: Grip, timeout: float) -> Gripped:
        """Carry out one command; one that was left under way is abandoned first.

        Raises:
            DeviceTimeout: it did not end in time; the hand is stopped.
            HardwareError: the connection is lost.
        """
        if self._busy:
            self.stop()
        if self._worker is None:
            raise HardwareError("the hand is not connected; enter it first")
        self._worker.send(request)
        self._busy = True
        try:
            return self._answer(f"the hand's {request.command}", timeout)
        except DeviceTimeout:
            self.stop()
            raise

    def state(self) -> GripperState:
        """The opening, and whether the hand reports an object."""
        now = self._ask(Grip("read"), READ_TIMEOUT)
        return GripperState(now.stamp, now.width, now.is_grasped)

    def homing(self, timeout: float) -> GripperResult:
        """Find the opening limits."""
        return self._result(self._ask(Grip("homing"), timeout))

    def move(self, width: float, speed: float, timeout: float) -> GripperResult:
        """Open or close to `width` [m] at `speed` [m/s]."""
        width = min(max(width, 0.0), self._max_width)
        return self._result(self._ask(Grip("move", (width, speed)), timeout))

    def grasp(
        self, width: float, speed: float, force: float, epsilon_inner: float, epsilon_outer: float, timeout: float
    ) -> GripperResult:
        """Close with `force` [N]; success iff the opening ends in the epsilon window [m], whatever the hand says."""
        answer = self._ask(Grip("grasp", (width, speed, force, epsilon_inner, epsilon_outer)), timeout)
        inside = width - epsilon_inner < answer.width < width + epsilon_outer
        said = answer.message or ("" if answer.success else "the hand itself reports no grasp")
        if not inside:
            said = f"stopped at {answer.width * 1e3:.1f} mm, wanted {width * 1e3:.1f} mm; {said}"
        return GripperResult(inside and not answer.message, answer.width, said)

    def stop(self) -> None:
        """Stop the fingers where they are. A command under way is abandoned: its connection is closed first.

        Raises:
            HardwareError: the hand cannot be reached.
        """
        if self._worker is None:
            return
        if self._busy:
            self._leave()
            self._connect()
        self._worker.send(Grip("stop"))
        self._answer("the hand to stop", READ_TIMEOUT)

    @staticmethod
    def _result(answer: Gripped) -> GripperResult:
        """A command's end, in the protocol's words."""
        return GripperResult(answer.success, answer.width, answer.message)
