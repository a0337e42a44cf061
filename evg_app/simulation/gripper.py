"""The simulated parallel gripper: two coupled fingers that hold by friction alone."""

import numpy as np
import pybullet

from evg_app.simulation.bullet import TIME_STEP
from evg_app.simulation.world import SimWorld
from evg_app.types import GripperResult, GripperState
from evg_app.unconnected import Unconnected

MOVE_FORCE = 20.0
"""Force limit of each finger when it moves or holds its place without a grasp command [N]."""
AT_WIDTH = 0.001
"""A move has arrived within this of its width [m]."""
STALL_SPEED, STALL_TIME = 0.002, 0.1
"""The fingers have stopped when slower than this [m/s] for this long [s]."""
NOTHING_BETWEEN = 0.001
"""Fingers closed to this have nothing between them [m]."""


class SimulatedGripper(Unconnected):
    """A `Gripper` in a `SimWorld`. Commands step the world until they end."""

    def __init__(self, world: SimWorld) -> None:
        self._world = world
        self._window: tuple[float, float] | None = None
        self._stopped = False
        world.on_reset.append(self._renew)
        self._renew()

    def _renew(self) -> None:
        """A new round begins: the fingers are open and hold nothing."""
        self._window = None
        self._drive(self._world.robot_config.gripper.max_width_m, 0.1, MOVE_FORCE)

    def _fingers(self) -> tuple[float, float]:
        """Opening [m] and its speed [m/s]."""
        states = self._world.client.getJointStates(self._world.robot.body, self._world.robot.fingers)
        return float(states[0][0] + states[1][0]), float(states[0][1] + states[1][1])

    def state(self) -> GripperState:
        """Opening, and whether a grasp command ended on something and the fingers still stand in its window."""
        width, speed = self._fingers()
        held = self._window is not None and self._window[0] < width < self._window[1]
        held = held and width > NOTHING_BETWEEN and abs(speed) < 10 * STALL_SPEED
        return GripperState(self._world.time, width, held)

    def _drive(self, width: float, speed: float, force: float) -> None:
        for finger in self._world.robot.fingers:
            self._world.client.setJointMotorControl2(
                self._world.robot.body,
                finger,
                pybullet.POSITION_CONTROL,
                targetPosition=width / 2,
                force=force,
                maxVelocity=max(speed, 1e-3) / 2,
                positionGain=0.2,
            )

    def _run(self, width: float, timeout: float) -> str:
        """Step until the fingers arrive, stall or are stopped: which of "arrived", "stalled", "stopped", "timeout"."""
        self._stopped = False
        end, still = self._world.time + timeout, 0.0
        while self._world.time < end:
            self._world.step()
            now, speed = self._fingers()
            still = still + TIME_STEP if abs(speed) < STALL_SPEED else 0.0
            if self._stopped:
                return "stopped"
            if still >= STALL_TIME:
                return "arrived" if abs(now - width) < AT_WIDTH else "stalled"
        return "timeout"

    def homing(self, timeout: float) -> GripperResult:
        """Open all the way."""
        return self.move(self._world.robot_config.gripper.max_width_m, 0.1, timeout)

    def move(self, width: float, speed: float, timeout: float) -> GripperResult:
        """Open or close to `width` [m] at `speed` [m/s]; fails when something is in the way."""
        width = float(np.clip(width, 0.0, self._world.robot_config.gripper.max_width_m))
        self._window = None
        self._drive(width, speed, MOVE_FORCE)
        self._world.solve_finely(False)
        ended = self._run(width, timeout)
        return GripperResult(ended == "arrived", self._fingers()[0], "" if ended == "arrived" else ended)

    def grasp(
        self, width: float, speed: float, force: float, epsilon_inner: float, epsilon_outer: float, timeout: float
    ) -> GripperResult:
        """Close with `force` [N] until the fingers stop; success iff the opening is in the epsilon window [m]."""
        self._window = (width - epsilon_inner, width + epsilon_outer)
        self._world.solve_finely(True)
        self._drive(0.0, speed, force)
        ended = self._run(0.0, timeout)
        final = self._fingers()[0]
        success = ended in ("stalled", "arrived") and self._window[0] < final < self._window[1]
        if not success:
            self._window = None
        message = "" if success else f"{ended} at {final * 1e3:.1f} mm, wanted {width * 1e3:.1f} mm"
        return GripperResult(success, final, message)

    def stop(self) -> None:
        """Keep the fingers where they are."""
        self._stopped, self._window = True, None
        self._drive(self._fingers()[0], 0.1, MOVE_FORCE)
