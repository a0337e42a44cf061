"""An arm behind limits that a person set: where the tool may go, who agrees to each motion, and who lets it go on
after it stopped by itself or was lost from sight. Software limits, not a safety function."""

import contextlib
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Self

import numpy as np

from evg_app.config.franka import ToolBox
from evg_app.errors import DeviceTimeout, HardwareError, Refused, Stopped
from evg_app.events import Event, MotionStarted
from evg_app.geometry import Array
from evg_app.identity import identity_of
from evg_app.robots.protocol import Arm, MotionHandle
from evg_app.types import ArmMode, ArmState, MotionResult, Trajectory

STRIDE = 5
"""Every STRIDE-th sample of a trajectory is checked against the tool box, and the last."""
STOPPED_MODES = (ArmMode.REFLEX, ArmMode.USER_STOPPED)
"""Modes in which the controller holds the arm until somebody acts."""

ToolPath = Callable[[Array], Array]
"""Positions (N, 3) [m] of the tool centre point in the base frame, for joint positions (N, J) [rad]."""
Ask = Callable[[str], bool]
"""Asks a person; whether the answer was yes."""


class GuardedArm:
    """An `Arm` that checks what another arm is told.

    Args:
        arm: the arm.
        tool_path: where the tool goes.
        box: where the tool may go, None for anywhere.
        step: asked before each motion, None for never.
        acknowledge: asked before the arm moves again after a protective stop, a reflex, or a motion lost from sight.
        dry: nothing is ever sent.
    """

    def __init__(
        self,
        arm: Arm,
        tool_path: ToolPath,
        box: ToolBox | None,
        acknowledge: Ask,
        step: Ask | None = None,
        dry: bool = False,
    ) -> None:
        self._arm, self._tool_path, self._box = arm, tool_path, box
        self._acknowledge, self._step, self._dry = acknowledge, step, dry
        self._next, self._under_way, self._halted, self._declined = "motion", "", "", False

    def listen(self, event: Event) -> None:
        """An event sink: learns the name of the motion that comes next."""
        if isinstance(event, MotionStarted):
            self._next = event.name

    @property
    def inner(self) -> Arm:
        """The arm that is guarded."""
        return self._arm

    @property
    def identity(self) -> Mapping[str, str]:
        """Of the arm that is guarded."""
        return identity_of(self._arm)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the J joints."""
        return self._arm.joint_names

    def __enter__(self) -> Self:
        self._arm.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._arm.__exit__(kind, error, trace)

    def state(self) -> ArmState:
        """The arm's state; a protective stop that it shows is remembered, and so is one lost in a motion."""
        try:
            state = self._arm.state()
        except HardwareError as error:
            if self._under_way:
                self.lost(self._under_way, error)
            raise
        if state.mode in STOPPED_MODES or state.errors:
            self._halted = self._halted or f"mode '{state.mode}', errors: {', '.join(state.errors) or 'none named'}"
        return state

    def execute(self, trajectory: Trajectory) -> MotionHandle:
        """Start a trajectory that stays in the tool box and that a person agrees to.

        Raises:
            Refused: it leaves the tool box, or this is a dry run.
            HardwareError: the arm stopped by itself before and nobody has let it go on; or from the arm.
            Stopped: the person said no.
        """
        name, self._next = self._next, "motion"
        if self._dry:
            raise Refused(f"dry run: '{name}' was not sent")
        self.state()
        if self._halted:
            raise HardwareError(f"the arm stopped by itself or was lost ({self._halted}); recover() first")
        self.check(name, trajectory)
        if self._step is not None and not self._step(self._described(name, trajectory)):
            raise Stopped(f"'{name}' was not agreed to; nothing was sent")
        motion = GuardedMotion(self, self._arm.execute(trajectory), name)
        self._under_way = name
        return motion

    def check(self, name: str, trajectory: Trajectory) -> None:
        """Pass when the tool stays in its box.

        Raises:
            Refused: where and when it would leave.
        """
        if self._box is None:
            return
        rows = np.unique(np.append(np.arange(0, len(trajectory.q), STRIDE), len(trajectory.q) - 1))
        points = self._tool_path(trajectory.q[rows])
        low, high = np.array(self._box.low_m), np.array(self._box.high_m)
        beyond = np.maximum(low - points, points - high)
        row, axis = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
        if beyond[row, axis] > 0.0:
            where = ", ".join(f"{v:.3f}" for v in points[row])
            raise Refused(
                f"'{name}' would take the tool to ({where}) m after {rows[row] * trajectory.dt:.1f} s, "
                f"{beyond[row, axis] * 1e3:.0f} mm beyond tool_box in {'xyz'[int(axis)]}; nothing was sent. "
                "Move the arm into the box by hand, or correct tool_box in the robot's YAML"
            )

    def _described(self, name: str, trajectory: Trajectory) -> str:
        """A motion in one question for a person."""
        start, end = self._tool_path(trajectory.q[[0, -1]])
        way = " to ".join("(" + ", ".join(f"{v:.3f}" for v in point) + ")" for point in (start, end))
        return f"{name}: {trajectory.duration:.1f} s, tool from {way} m. Go?"

    def recover(self, timeout: float) -> None:
        """Clear a reflex and wait until the arm is idle; after a stop of its own, or lost, only when a person agrees.

        Raises:
            HardwareError: nobody agreed; or from the arm.
            DeviceTimeout: it is not idle after `timeout` [s].
        """
        with contextlib.suppress(DeviceTimeout):
            self.state()
        if self._halted and not self._may_go_on():
            raise HardwareError(
                f"the arm stopped by itself or was lost ({self._halted}) and nobody let it go on; it holds. "
                "Clear the scene and run the command again"
            )
        self._arm.recover(timeout)
        self._under_way = self._halted = ""

    def _may_go_on(self) -> bool:
        """Ask once; a no stays a no."""
        question = f"The arm stopped ({self._halted}). Is the scene clear, and may it recover and move on?"
        self._declined = self._declined or not self._acknowledge(question)
        return not self._declined

    def lost(self, name: str, error: HardwareError) -> None:
        """Called by a motion that nobody can see any more: what the arm did meanwhile, nobody knows."""
        self._halted = self._halted or f"contact was lost during '{name}': {error}"

    def ended(self, result: MotionResult) -> None:
        """Called by a motion when it ends: one that fell short may have been a protective stop."""
        self._under_way = ""
        if not result.reached:
            self.state()


class GuardedMotion:
    """A motion of a guarded arm."""

    def __init__(self, guard: GuardedArm, motion: MotionHandle, name: str) -> None:
        self._guard, self._motion, self._name, self._told = guard, motion, name, False

    def wait(self, timeout: float) -> MotionResult | None:
        """Wait at most `timeout` [s]; the result once the motion has ended, None while it still moves.

        Raises:
            HardwareError: contact to the arm was lost; nothing moves before a person agrees.
        """
        try:
            result = self._motion.wait(timeout)
        except HardwareError as error:
            self._guard.lost(self._name, error)
            raise
        if result is not None and not self._told:
            self._told = True
            self._guard.ended(result)
        return result

    def cancel(self) -> None:
        """Stop this motion."""
        self._motion.cancel()
