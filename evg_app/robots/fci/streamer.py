"""The streaming process: owns the connection to the arm, publishes every state, streams motions at 1 kHz.

It imports nothing heavy, ignores Ctrl-C (the application decides), and stops a motion on its own path when the
application asks, dies, or looks away for too long.
"""

import gc
import os
import signal
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from evg_app.geometry import Array
from evg_app.robots.fci import realtime
from evg_app.robots.fci.messages import (
    Configure,
    Done,
    Ended,
    Execute,
    Facts,
    Failed,
    Leave,
    Recover,
    Started,
)
from evg_app.robots.fci.profile import Pace, Profile
from evg_app.robots.fci.shared import Orders, StateBlock, StateWriter

CHECK_EVERY = 20
"""Cycles between two looks at whether the application still lives."""
SETTLE_CYCLES, SETTLED_RAD_S = 500, 0.01
"""After a motion the arm may take so many of the controller's cycles to come below this speed [rad/s]."""
MODES = ("Other", "Idle", "Move", "Guiding", "Reflex", "UserStopped", "AutomaticErrorRecovery")
"""libfranka's robot modes; the index is what is published."""
IDLE, REFLEX, USER_STOPPED = 1, 4, 5


@dataclass(frozen=True)
class Options:
    """What the process needs to know; see `config.franka.FciModel`."""

    host: str
    realtime: str
    priority: int
    core: int | None
    look_away_s: float


def main(pipe: Connection, block: StateBlock, orders: Orders, options: Options) -> None:
    """Entry of the process."""
    for number in (signal.SIGINT, signal.SIGHUP):  # both reach the whole process group; the application decides
        signal.signal(number, signal.SIG_IGN)
    gc.disable()
    try:
        link = _connect(pipe, block, orders, options)
        if link is not None:
            link.serve()
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


def _connect(pipe: Connection, block: StateBlock, orders: Orders, options: Options) -> "Link | None":
    """Connect and say so; None after a refusal, which is passed on."""
    try:
        import pylibfranka
    except ImportError as error:
        pipe.send(Failed("ImportError", str(error)))
        return None
    found = realtime.machine()
    enforce = options.realtime == "enforce" or (
        options.realtime == "auto" and found.realtime_kernel and found.priority > 0
    )
    config = pylibfranka.RealtimeConfig.kEnforce if enforce else pylibfranka.RealtimeConfig.kIgnore
    try:
        robot = pylibfranka.Robot(options.host, config)
        got = "ordinary scheduling"
        if options.realtime != "ignore":
            got = realtime.take(found, options.priority, options.core)
        link = Link(pipe, block, orders, options, pylibfranka, robot, got)
        link.publish(robot.read_once())
        pipe.send(Done(link.facts()))
    except (RuntimeError, pylibfranka.FrankaException) as error:
        pipe.send(Failed(type(error).__name__, str(error)))
        return None
    return link


class Link:
    """The connected arm."""

    def __init__(
        self,
        pipe: Connection,
        block: StateBlock,
        orders: Orders,
        options: Options,
        library: Any,
        robot: Any,
        scheduling: str,
    ) -> None:
        self._pipe, self._orders, self._options = pipe, orders, options
        self._library, self._robot, self._scheduling = library, robot, scheduling
        self._writer = StateWriter(block)
        self._modes = {getattr(library.RobotMode, name): k for k, name in enumerate(MODES)}
        self._error_names = tuple(sorted(n for n in dir(library.Errors) if not n.startswith("_")))
        self._parent = os.getppid()
        self._last_ms: int | None = None
        self._received = self._lost = self._longest = 0
        self._mode = IDLE

    def publish(self, state: Any, moving: bool = False) -> None:
        """Share a state, and count those lost since the one before."""
        now_ms = round(state.time.to_sec() * 1e3)
        gap = 0 if self._last_ms is None else max(now_ms - self._last_ms - 1, 0)
        self._last_ms = now_ms
        self._received, self._lost, self._longest = self._received + 1, self._lost + gap, max(self._longest, gap)
        self._mode = self._modes.get(state.robot_mode, 0)
        unwell = self._mode in (REFLEX, USER_STOPPED)
        self._writer.write(
            stamp=time.monotonic(),
            mode=self._mode,
            moving=moving,
            errors=self._bits(state.current_errors) if unwell else 0,
            q=state.q,
            dq=state.dq,
            q_d=state.q_d,
            wrench=state.O_F_ext_hat_K,
            success_rate=state.control_command_success_rate,
            received=self._received,
            lost=self._lost,
            longest=self._longest,
        )

    def _bits(self, errors: Any) -> int:
        """Active errors, one bit each."""
        return sum(1 << k for k, name in enumerate(self._error_names) if getattr(errors, name))

    def facts(self) -> Facts:
        """What the controller says about itself now."""
        state = self._robot.read_once()
        F_T_NE, NE_T_EE, F_T_EE, O_T_EE = (
            np.array(m).reshape(4, 4, order="F") for m in (state.F_T_NE, state.NE_T_EE, state.F_T_EE, state.O_T_EE)
        )
        version = str(self._library.__version__)
        return Facts(
            version,
            np.array(state.q),
            F_T_NE,
            NE_T_EE,
            F_T_EE,
            O_T_EE,
            float(state.m_ee),
            float(state.m_load),
            self._error_names,
            self._scheduling,
        )

    def serve(self) -> None:
        """Publish states and carry out requests until told to leave."""
        while self._alive():
            try:
                self.publish(self._robot.read_once())
                if self._pipe.poll(0):
                    request = self._pipe.recv()
                    if isinstance(request, Leave):
                        return
                    self._answer(request)
            except self._library.NetworkException as error:
                self._pipe.send(Failed("NetworkException", str(error)))
                return

    def _alive(self) -> bool:
        """Whether the application still lives."""
        return os.getppid() == self._parent

    def _answer(self, request: object) -> None:
        """Carry out one request; what the controller refuses is passed on."""
        try:
            if isinstance(request, Execute):
                self._execute(request)
            elif isinstance(request, Recover):
                self._robot.automatic_error_recovery()
                self.publish(self._robot.read_once())
                self._pipe.send(Done())
            elif isinstance(request, Configure):
                self._configure(request)
                self._pipe.send(Done(self.facts()))
        except self._library.NetworkException:
            raise
        except (RuntimeError, self._library.FrankaException) as error:
            self._pipe.send(Failed(type(error).__name__, str(error)))

    def _configure(self, request: Configure) -> None:
        """Set frame, load and thresholds, and let them show in the states."""
        if request.NE_T_EE is not None:
            self._robot.set_EE(request.NE_T_EE.ravel(order="F").tolist())
        inertia = np.diag([1e-3 * request.load_mass_kg] * 3).ravel().tolist()
        self._robot.set_load(request.load_mass_kg, list(request.load_center_m), inertia)
        torque, force = list(request.torque_nm), list(request.force)
        self._robot.set_collision_behavior(torque, torque, force, force)
        for _ in range(20):
            self.publish(self._robot.read_once())

    def _execute(self, request: Execute) -> None:
        """Stream one motion to its end, and say how it ended."""
        profile = Profile(request.q, request.dq, request.ddq, request.dt)
        lost, received = self._lost, self._received
        control = self._robot.start_joint_position_control(self._library.ControllerMode.JointImpedance)
        self._pipe.send(Started(request.motion))
        reason = failure = ""
        try:
            reason = self._stream(control, request, profile)
        except self._library.NetworkException:
            raise
        except (RuntimeError, self._library.FrankaException) as error:
            failure = str(error)
        error_left = self._settle(profile.goal)
        self._pipe.send(
            Ended(
                request.motion,
                failure or reason,
                stopped=bool(reason),
                failed=bool(failure),
                goal_error=error_left,
                lost=self._lost - lost,
                cycles=self._received - received,
            )
        )

    def _stream(self, control: Any, request: Execute, profile: Profile) -> str:
        """Stream until the end; why it was braked before, or empty."""
        pace, cycle, reason = Pace(), 0, ""
        state, _ = control.readOnce()
        profile.begin_at(np.array(state.q_d))
        period = 0.0
        while True:
            s = pace.advance(period)
            command = self._library.JointPositions(profile.at(s).tolist())
            finished = s >= profile.duration or pace.stopped
            command.motion_finished = finished
            control.writeOnce(command)
            self.publish(state, moving=True)
            if finished:
                return reason
            cycle += 1
            if not reason:
                reason = self._why_stop(request.motion, cycle)
                if reason:
                    pace.brake(profile.velocity(s), request.acceleration, request.jerk)
            state, duration = control.readOnce()
            period = duration.to_sec()

    def _why_stop(self, motion: int, cycle: int) -> str:
        """Why the motion must brake now, or empty."""
        if self._orders.cancelled(motion):
            return "cancelled"
        if cycle % CHECK_EVERY == 0:
            if not self._alive():
                return "the application died"
            if time.monotonic() - self._orders.looked() > self._options.look_away_s:
                return f"nobody looked at the motion for {self._options.look_away_s:g} s"
        return ""

    def _settle(self, goal: Array) -> float:
        """Wait until the arm is at rest; its largest distance to the goal [rad]."""
        still = 0
        for _ in range(SETTLE_CYCLES):
            state = self._robot.read_once()
            self.publish(state, moving=True)
            still = still + 1 if max(abs(v) for v in state.dq) < SETTLED_RAD_S else 0
            if still >= 5:
                break
        self.publish(state)
        return float(np.abs(np.array(state.q) - goal).max())
