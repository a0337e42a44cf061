"""The arm over the Franka Control Interface: a `robots.protocol.Arm` in front of the streaming process."""

import time
from types import TracebackType
from typing import Self

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.errors import DeviceTimeout, HardwareError, Refused
from evg_app.robots.fci import envelope, handshake
from evg_app.robots.fci.arm_process import ArmProcess
from evg_app.robots.fci.messages import Done, Ended, Execute, Failed, Recover, Started
from evg_app.robots.fci.motion import FciMotion
from evg_app.robots.fci.profile import Profile
from evg_app.robots.fci.shared import Snapshot
from evg_app.robots.fci.streamer import IDLE, MODES, REFLEX, USER_STOPPED
from evg_app.types import ArmMode, ArmState, MotionResult, Trajectory

START_TIMEOUT = 3.0
"""It must take a motion within this [s]."""
STALE_S = 0.5
"""A state older than this is no state [s]."""
START_TOLERANCE = 0.02
"""A trajectory must start this close to where the arm is [rad]."""

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
        self.process = ArmProcess(robot, self._finish)
        self._motion: FciMotion | None = None
        self._number = 0
        self.warnings: tuple[str, ...] = ()
        """What a person should know about this connection."""

    @property
    def identity(self) -> dict[str, str]:
        """Library, address and load as the controller stated them; the serial number is the config's."""
        told = {"driver": "fci", "serial": self._robot.serial, "host": self._robot.fci.host}
        facts = self.process.facts
        if facts is not None:
            told |= {"pylibfranka": facts.library, "hand mass [kg]": f"{facts.m_ee:.3f}", "scheduling": facts.realtime}
        return told

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the seven joints."""
        return tuple(self._robot.joints)

    def __enter__(self) -> Self:
        try:
            self.warnings = self.process.connect(self._tool_pose)
        except BaseException:
            self.process.leave()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._motion is not None and self.process.started:
            self._motion.cancel()
            end = time.monotonic() + START_TIMEOUT
            while self._motion is not None and not self.process.broken and time.monotonic() < end:
                self.process.take(0.05)
        self.process.leave()

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
        """Names of the errors whose bits are set."""
        names = () if self.process.facts is None else self.process.facts.error_names
        return tuple(name for k, name in enumerate(names) if now.errors >> k & 1)

    def _snapshot(self) -> Snapshot:
        """The latest state, if it is fresh; see `state` for what it raises."""
        self.process.running()
        now = self.process.block.read()
        if now is None or time.monotonic() - now.stamp > STALE_S:
            self.process.take(0.0)
            self.process.require_link()
            raise DeviceTimeout(
                "a fresh state of the arm", STALE_S, f"Check the cable, then run: ping {self._robot.fci.host}"
            )
        return now

    def link_quality(self) -> tuple[int, int, int]:
        """States received, states lost, and most lost in a row since connecting; while the network plans, too."""
        now = self.process.block.read()
        return (0, 0, 0) if now is None else (now.received, now.lost, now.longest)

    def execute(self, trajectory: Trajectory) -> FciMotion:
        """Start a trajectory.

        Raises:
            Refused: it does not start where the arm is, is for other joints, or breaks the controller's limits.
            HardwareError: the arm is in a reflex, stopped by a person, still moving, or the controller rejects it.
        """
        self.process.take(0.0)
        self.process.require_link()
        self._require_ready(trajectory)
        limits = self._robot.limits
        self._number += 1
        self.process.orders.look()
        request = Execute(
            self._number,
            trajectory.q,
            trajectory.dq,
            trajectory.ddq,
            trajectory.dt,
            np.minimum(limits.acceleration_rad_s2, envelope.FR3.acceleration),
            np.minimum(limits.jerk_rad_s3, envelope.FR3.jerk),
        )
        answer = self.process.request(request, Started, "the controller to start the motion", START_TIMEOUT)
        if isinstance(answer, Failed):
            raise HardwareError(f"the controller rejected the motion: {answer.text}")
        self._motion = FciMotion(self, self._number)
        return self._motion

    def _require_ready(self, trajectory: Trajectory) -> None:
        """Pass when this trajectory may be sent now; see `execute` for what it raises."""
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
            self.process.take(0.05)
        self.process.require_link()
        state = self.state()
        if state.mode is ArmMode.USER_STOPPED:
            raise HardwareError("the arm was stopped by a person: release the stop button, unlock the joints in Desk")
        if state.mode is ArmMode.REFLEX:
            left = max(end - time.monotonic(), 0.1)
            answer = self.process.request(Recover(), Done, "the controller to recover", left)
            if isinstance(answer, Failed):
                raise HardwareError(f"the controller did not recover: {answer.text}. Look at Desk for the cause")
        while (now := self._snapshot()).mode != IDLE or now.moving:
            if time.monotonic() >= end:
                raise DeviceTimeout("the arm to be idle", timeout, f"It is in mode '{MODES[now.mode]}'. Look at Desk.")
            self.process.take(0.02)

    def _finish(self, ended: Ended) -> None:
        """Settle the motion under way, if it is this one that ended."""
        if self._motion is not None and self._motion.number == ended.motion:
            self._motion.finish(ended)
            self._motion = None

    def wait(self, motion: FciMotion, timeout: float) -> MotionResult | None:
        """Wait for a motion; called by the motion itself.

        Raises:
            HardwareError: the connection is lost.
        """
        self.process.orders.look()
        self.process.take(timeout)
        if motion.result is None and self.process.broken:
            self._motion = None
            raise HardwareError(self.process.broken)
        return motion.result

    def cancel(self, motion: FciMotion) -> None:
        """Stop a motion; called by the motion itself."""
        self.process.orders.cancel(motion.number)
