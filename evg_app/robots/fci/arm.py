"""The arm over the Franka Control Interface: a `robots.protocol.Arm` in front of the streaming process."""

import time
from types import TracebackType
from typing import Self

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.errors import DeviceTimeout, HardwareError, MissingExtra, Refused
from evg_app.robots.fci import envelope, handshake, realtime, versions
from evg_app.robots.fci.messages import Done, Ended, Execute, Facts, Failed, Leave, Recover, Started
from evg_app.robots.fci.profile import Profile
from evg_app.robots.fci.shared import Orders, Snapshot, StateBlock
from evg_app.robots.fci.streamer import IDLE, MODES, REFLEX, USER_STOPPED, Options, main
from evg_app.robots.fci.worker import Worker
from evg_app.types import ArmMode, ArmState, MotionResult, Trajectory

CONNECT_TIMEOUT = 30.0
"""The controller must answer within this [s]."""
START_TIMEOUT = 3.0
"""It must take a motion within this [s]."""
TAKE_TIMEOUT = 1.0
"""Frames that were set must show in the controller's states within this [s]."""
TAKES = "the controller to take frames and thresholds"
STALE_S = 0.5
"""A state older than this is no state [s]."""
START_TOLERANCE = 0.02
"""A trajectory must start this close to where the arm is [rad]."""
GOAL_TOLERANCE = 0.01
"""The goal counts as reached within this [rad]."""

_MODES = {
    "Idle": ArmMode.IDLE,
    "Move": ArmMode.MOVING,
    "Guiding": ArmMode.GUIDING,
    "Reflex": ArmMode.REFLEX,
    "UserStopped": ArmMode.USER_STOPPED,
}


class FciArm:
    """A Franka Research 3 without ROS.

    Args:
        robot: its config; `fci` says how to connect.
        tool_pose: T_base_tcp of our model, compared with the controller's at connect.
    """

    def __init__(self, robot: RobotConfig, tool_pose: handshake.ToolPose) -> None:
        self._robot, self._tool_pose = robot, tool_pose
        self._block, self._orders = StateBlock(), Orders()
        self._worker: Worker | None = None
        self._motion: FciMotion | None = None
        self._number, self._broken = 0, ""
        self.facts: Facts | None = None
        """What the controller said at connect, None before."""
        self.warnings: tuple[str, ...] = ()
        """What a person should know about this connection."""

    @property
    def identity(self) -> dict[str, str]:
        """Library, address and load as the controller stated them; the serial number is the config's."""
        told = {"driver": "fci", "serial": self._robot.serial, "host": self._robot.fci.host}
        facts = self.facts
        if facts is not None:
            told |= {"pylibfranka": facts.library, "hand mass [kg]": f"{facts.m_ee:.3f}", "scheduling": facts.realtime}
        return told

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the seven joints."""
        return tuple(self._robot.joints)

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
        if self._motion is not None and self._worker is not None:
            self._motion.cancel()
            end = time.monotonic() + START_TIMEOUT
            while self._motion is not None and not self._broken and time.monotonic() < end:
                self._take(0.05)
        self._leave()

    def _connect(self) -> None:
        fci = self._robot.fci
        options = Options(fci.host, fci.realtime, fci.priority, fci.core, fci.look_away_s)
        self._broken = ""
        self._worker = Worker("arm", main, (self._block, self._orders, options), Leave())
        before = self._facts(CONNECT_TIMEOUT, f"the robot at {fci.host} to answer")
        self._worker.send(handshake.configuration(self._robot, before))
        self.facts = self._facts(START_TIMEOUT, TAKES)
        warnings = handshake.require(self._differences(before))
        if fci.arm == "fer":
            text = f"the arm is an FR3, robot '{self._robot.name}' is configured as a Panda (fci.arm: fer)"
            warnings += (f"{text}: every motion is checked against the FR3's limits as well",)
        found = realtime.machine()
        if fci.realtime != "ignore":
            realtime.leave_core(found, fci.core)
        self.warnings = warnings + tuple(realtime.advice(found))

    def _differences(self, before: Facts) -> list[handshake.Finding]:
        """What differs from our model once the controller has taken the configuration."""
        end = time.monotonic() + TAKE_TIMEOUT
        while True:
            assert self.facts is not None
            found = handshake.differences(self._robot, before, self.facts, self._tool_pose)
            if time.monotonic() > end or not any(f.fault for f in found):
                return found
            self._running().send(handshake.configuration(self._robot, self.facts))
            self.facts = self._facts(START_TIMEOUT, TAKES)

    def _facts(self, timeout: float, what: str) -> Facts:
        worker = self._running()
        host = self._robot.fci.host
        answer = worker.wait(what, timeout, versions.connect_advice("", "timeout: imeout", host))
        if isinstance(answer, Done) and answer.facts is not None:
            return answer.facts
        if isinstance(answer, Failed):
            if answer.kind == "ImportError":
                raise MissingExtra("pylibfranka", "franka")
            advice = versions.connect_advice(answer.kind, answer.text, host)
            raise HardwareError(f"no connection to the robot at {host}: {answer.text} {advice}")
        raise HardwareError(f"unexpected answer of the arm process: {answer}")

    def _running(self) -> Worker:
        if self._worker is None:
            raise HardwareError("the arm is not connected; enter it first")
        return self._worker

    def _leave(self) -> None:
        if self._worker is not None:
            self._worker.end()
            self._worker = None

    def state(self) -> ArmState:
        """The latest state; the wrench is the controller's estimate of external force at the tool, base frame.

        Raises:
            DeviceTimeout: the state is older than `STALE_S`.
            HardwareError: the connection is lost.
        """
        now = self._snapshot()
        mode = ArmMode.MOVING if now.moving else _MODES.get(MODES[now.mode], ArmMode.OTHER)
        if now.mode in (REFLEX, USER_STOPPED):
            mode = _MODES[MODES[now.mode]]
        return ArmState(now.stamp, now.q, now.dq, mode, self._error_names(now), now.wrench)

    def _error_names(self, now: Snapshot) -> tuple[str, ...]:
        names = () if self.facts is None else self.facts.error_names
        return tuple(name for k, name in enumerate(names) if now.errors >> k & 1)

    def _snapshot(self) -> Snapshot:
        self._running()
        now = self._block.read()
        if now is None or time.monotonic() - now.stamp > STALE_S:
            self._take(0.0)
            self._require_link()
            raise DeviceTimeout(
                "a fresh state of the arm", STALE_S, f"Check the cable, then run: ping {self._robot.fci.host}"
            )
        return now

    def _require_link(self) -> None:
        if self._broken:
            raise HardwareError(self._broken)

    def link_quality(self) -> tuple[int, int, int]:
        """States received, states lost, and most lost in a row since connecting; while the network plans, too."""
        now = self._block.read()
        return (0, 0, 0) if now is None else (now.received, now.lost, now.longest)

    def execute(self, trajectory: Trajectory) -> "FciMotion":
        """Start a trajectory.

        Raises:
            Refused: it does not start where the arm is, is for other joints, or breaks the controller's limits.
            HardwareError: the arm is in a reflex, stopped by a person, still moving, or the controller rejects it.
        """
        self._take(0.0)
        self._require_link()
        self._require_ready(trajectory)
        limits = self._robot.limits
        self._number += 1
        self._orders.look()
        request = Execute(
            self._number,
            trajectory.q,
            trajectory.dq,
            trajectory.ddq,
            trajectory.dt,
            np.minimum(limits.acceleration_rad_s2, envelope.FR3.acceleration),
            np.minimum(limits.jerk_rad_s3, envelope.FR3.jerk),
        )
        answer = self._request(request, Started, "the controller to start the motion", START_TIMEOUT)
        if isinstance(answer, Failed):
            self._failed(answer)
            raise HardwareError(f"the controller rejected the motion: {answer.text}")
        self._motion = FciMotion(self, self._number)
        return self._motion

    def _require_ready(self, trajectory: Trajectory) -> None:
        if self._motion is not None:
            raise HardwareError("the arm is still moving; cancel the motion under way and wait for it first")
        state = self.state()
        if state.mode in (ArmMode.REFLEX, ArmMode.USER_STOPPED):
            errors = ", ".join(state.errors) or "none named"
            raise HardwareError(f"the arm is in mode '{state.mode}' (errors: {errors}); recover() first")
        if trajectory.joint_names != self.joint_names:
            raise Refused(f"trajectory for joints {trajectory.joint_names}, the arm has {self.joint_names}")
        gap = float(np.abs(trajectory.q[0] - state.q).max())
        if not gap <= START_TOLERANCE:
            raise Refused(f"trajectory starts {gap:.3f} rad from the arm (allowed {START_TOLERANCE}); plan it anew")
        profile = Profile(trajectory.q, trajectory.dq, trajectory.ddq, trajectory.dt)
        profile.begin_at(self._snapshot().q_d)
        envelope.check(envelope.FR3, profile.sampled(envelope.CYCLE), self.joint_names)

    def recover(self, timeout: float) -> None:
        """Run the controller's automatic error recovery and wait until the arm is idle.

        Raises:
            DeviceTimeout: it is not idle after `timeout` [s].
            HardwareError: the connection is lost, or a person must act first.
        """
        end = time.monotonic() + timeout
        while self._motion is not None and time.monotonic() < end:
            self._motion.cancel()
            self._take(0.05)
        self._require_link()
        state = self.state()
        if state.mode is ArmMode.USER_STOPPED:
            raise HardwareError("the arm was stopped by a person: release the stop button, unlock the joints in Desk")
        if state.mode is ArmMode.REFLEX:
            answer = self._request(Recover(), Done, "the controller to recover", max(end - time.monotonic(), 0.1))
            if isinstance(answer, Failed):
                self._failed(answer)
                raise HardwareError(f"the controller did not recover: {answer.text}. Look at Desk for the cause")
        while (now := self._snapshot()).mode != IDLE or now.moving:
            if time.monotonic() >= end:
                raise DeviceTimeout("the arm to be idle", timeout, f"It is in mode '{MODES[now.mode]}'. Look at Desk.")
            self._take(0.02)

    def _request(self, request: object, wanted: type, what: str, timeout: float) -> object:
        """Send a request and wait for its answer or `Failed`; the end of a motion may come in between.

        Raises:
            DeviceTimeout: no answer within `timeout` [s].
            HardwareError: the process is gone.
        """
        worker, end = self._running(), time.monotonic() + timeout
        worker.send(request)
        while True:
            answer = worker.wait(what, max(end - time.monotonic(), 0.0), "Look at Desk for an error.")
            if isinstance(answer, wanted | Failed):
                return answer
            if isinstance(answer, Ended):
                self._finish(answer)

    def _finish(self, ended: Ended) -> None:
        if self._motion is not None and self._motion.number == ended.motion:
            self._motion.finish(ended)
            self._motion = None

    def _take(self, timeout: float) -> None:
        """Take what the process has to say, waiting at most `timeout` [s] for the first."""
        if self._worker is None or self._broken:
            return
        try:
            message = self._worker.poll(timeout)
            while message is not None:
                if isinstance(message, Ended):
                    self._finish(message)
                elif isinstance(message, Failed):
                    self._failed(message)
                message = self._worker.poll(0.0)
        except HardwareError as error:
            self._broken = self._broken or str(error)

    def _failed(self, failed: Failed) -> None:
        if failed.kind == "NetworkException":
            host = self._robot.fci.host
            self._broken = (
                f"the connection to the robot at {host} is lost: {failed.text} The controller stops the arm by itself. "
                f"Run: ping {host}, look at Desk, then run the command again"
            )

    def wait(self, motion: "FciMotion", timeout: float) -> MotionResult | None:
        """Wait for a motion; called by the motion itself.

        Raises:
            HardwareError: the connection is lost.
        """
        self._orders.look()
        self._take(timeout)
        if motion.result is None and self._broken:
            self._motion = None
            raise HardwareError(self._broken)
        return motion.result

    def cancel(self, motion: "FciMotion") -> None:
        """Stop a motion; called by the motion itself."""
        self._orders.cancel(motion.number)


class FciMotion:
    """A motion under way."""

    def __init__(self, arm: FciArm, number: int) -> None:
        self._arm, self.number = arm, number
        self.result: MotionResult | None = None
        """How it ended, None while it moves."""
        self.ended: Ended | None = None
        """More about its end: lost states, cycles."""

    def wait(self, timeout: float) -> MotionResult | None:
        """Wait at most `timeout` [s]; the result once the motion has ended.

        Raises:
            HardwareError: the connection is lost.
        """
        return self.result if self.result is not None else self._arm.wait(self, timeout)

    def cancel(self) -> None:
        """Brake on the path; the controller then holds the arm."""
        if self.result is None:
            self._arm.cancel(self)

    def finish(self, ended: Ended) -> None:
        """Settle the result."""
        reached = not ended.stopped and not ended.failed and ended.goal_error < GOAL_TOLERANCE
        reason = ended.reason or ("reached" if reached else f"not at the goal: {ended.goal_error:.3f} rad away")
        self.ended = ended
        self.result = MotionResult(reached, reason, ended.goal_error)
