"""The simulated arm: tracks trajectories with position control and reports a stamped state."""

from types import TracebackType
from typing import Self

import numpy as np
import pybullet

from evg_app.errors import DeviceTimeout, HardwareError, Refused
from evg_app.geometry import T_GRASP_TCP, T_HAND_GRASP, Array
from evg_app.simulation.bullet import TIME_STEP
from evg_app.simulation.panda import external_wrench
from evg_app.simulation.world import SimWorld
from evg_app.types import ArmMode, ArmState, MotionResult, Trajectory

START_TOLERANCE = 0.02
"""A trajectory must start this close to where the arm is [rad]."""
GOAL_TOLERANCE = 0.005
"""The goal counts as reached within this [rad]."""
REST_SPEED, REST_STEPS = 0.02, 8
"""The arm rests when every joint is slower than this [rad/s] for this many steps."""
SETTLE_TIME = 0.5
"""How long the arm may take to come to rest after the last sample [s]."""
REFLEX_LAG = 0.12
"""The arm stops with a reflex when a joint lags this far behind its command [rad]: something holds it."""
POSITION_GAIN, VELOCITY_GAIN = 0.3, 1.0
"""Of PyBullet's position control: share of the error corrected in one step."""


class SimulatedArm:
    """An `Arm` in a `SimWorld`. Waiting steps the world."""

    def __init__(self, world: SimWorld) -> None:
        self._world = world
        self._motion: SimulatedMotion | None = None
        self._errors: tuple[str, ...] = ()
        self._command = np.array(world.robot_config.look_q_rad, dtype=np.float64)
        self._acceleration = np.array(world.robot_config.limits.acceleration_rad_s2, dtype=np.float64)
        world.before_step.append(self._act)
        world.on_reset.append(self._renew)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the J joints."""
        return self._world.robot_config.joints

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._motion is not None:
            self._motion.cancel()

    def _renew(self) -> None:
        """A new round begins: the arm stands at its look pose."""
        if self._motion is not None:
            self._motion.end(False, "the world was reset")
        self._errors, self._command = (), np.array(self._world.robot_config.look_q_rad, dtype=np.float64)

    def _joints(self) -> tuple[Array, Array]:
        states = self._world.client.getJointStates(self._world.robot.body, self._world.robot.joints)
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    def state(self) -> ArmState:
        """The state now; the wrench sums the contact forces on the moving links (no sensor noise, no payload)."""
        q, dq = self._joints()
        tcp = (self._world.T_base_hand() @ T_HAND_GRASP @ T_GRASP_TCP)[:3, 3]
        wrench = external_wrench(self._world.client, self._world.robot, tcp)
        moving = self._motion is not None
        mode = ArmMode.REFLEX if self._errors else ArmMode.MOVING if moving else ArmMode.IDLE
        return ArmState(self._world.time, q, dq, mode, self._errors, wrench)

    def execute(self, trajectory: Trajectory) -> "SimulatedMotion":
        """Start a trajectory.

        Raises:
            Refused: it does not start where the arm is, or is for other joints.
            HardwareError: the arm is in a reflex, or still moving.
        """
        if self._errors:
            raise HardwareError(f"the arm is in a reflex ({', '.join(self._errors)}); recover() first")
        if self._motion is not None:
            raise HardwareError("the arm is still moving; cancel the motion under way and wait for it first")
        if trajectory.joint_names != self.joint_names:
            raise Refused(f"trajectory for joints {trajectory.joint_names}, the arm has {self.joint_names}")
        gap = float(np.abs(trajectory.q[0] - self._joints()[0]).max())
        if not gap <= START_TOLERANCE:
            raise Refused(f"trajectory starts {gap:.3f} rad from the arm (allowed {START_TOLERANCE}); plan it anew")
        self._motion = SimulatedMotion(self, self._world, trajectory, self._acceleration)
        return self._motion

    def recover(self, timeout: float) -> None:
        """Clear a reflex and wait until the arm is at rest.

        Raises:
            DeviceTimeout: it is not at rest after `timeout` [s].
        """
        self._errors, self._command = (), self._joints()[0]
        end = self._world.time + timeout
        while float(np.abs(self._joints()[1]).max()) > REST_SPEED or self._motion is not None:
            if self._world.time >= end:
                raise DeviceTimeout("the simulated arm to come to rest", timeout, "Something pushes it.")
            self._world.step()

    def _act(self) -> None:
        """Before each step: send the next set point, watch the lag, notice the end."""
        target, speed = self._command, np.zeros(len(self._command))
        motion = self._motion
        if motion is not None:
            target, speed = motion.advance()
        robot = self._world.robot
        self._world.client.setJointMotorControlArray(
            robot.body,
            robot.joints,
            pybullet.POSITION_CONTROL,
            targetPositions=target,
            targetVelocities=speed,
            forces=robot.efforts,
            positionGains=[POSITION_GAIN] * len(target),
            velocityGains=[VELOCITY_GAIN] * len(target),
        )
        self._command = target
        if motion is not None:
            self._watch(motion, *self._joints())

    def _watch(self, motion: "SimulatedMotion", q: Array, dq: Array) -> None:
        lag = np.abs(q - self._command)
        if float(lag.max()) > REFLEX_LAG:
            self._errors = (f"{self.joint_names[int(lag.argmax())]} held back by {lag.max():.2f} rad",)
            self._command = q
            motion.end(False, f"reflex: {self._errors[0]}")
        else:
            motion.finish_if_done(q, dq)

    def finished(self, motion: "SimulatedMotion") -> None:
        """Called by a motion when it ends."""
        if self._motion is motion:
            self._motion = None


class SimulatedMotion:
    """A motion of the simulated arm."""

    def __init__(self, arm: SimulatedArm, world: SimWorld, trajectory: Trajectory, acceleration: Array) -> None:
        self._arm, self._world, self._trajectory, self._acceleration = arm, world, trajectory, acceleration
        self._elapsed, self._still = 0.0, 0
        self._braking: tuple[Array, Array, float, float] | None = None
        self._result: MotionResult | None = None
        self._last = (trajectory.q[0].copy(), np.zeros(trajectory.q.shape[1]))

    def wait(self, timeout: float) -> MotionResult | None:
        """Step the world at most `timeout` [s]; the result once the motion has ended."""
        end = self._world.time + timeout - 1e-9
        while self._result is None and self._world.time < end:
            self._world.step()
        return self._result

    def cancel(self) -> None:
        """Brake at the acceleration limits, all joints in step."""
        if self._result is None and self._braking is None:
            q, dq = self._last
            self._braking = (q, dq, float((np.abs(dq) / self._acceleration).max()), self._elapsed)

    def advance(self) -> tuple[Array, Array]:
        """Set points q [rad] and dq [rad/s] of the next step. Shapes (J,), (J,)."""
        self._elapsed += TIME_STEP
        if self._braking is None:
            self._last = self._sample(self._elapsed)
        else:
            q, dq, duration, begin = self._braking
            t = min(self._elapsed - begin, duration)
            left = 1.0 - t / duration if duration > 0 else 0.0
            self._last = (q + dq * (t - 0.5 * t * t / duration if duration > 0 else 0.0), dq * left)
        return self._last

    def _sample(self, t: float) -> tuple[Array, Array]:
        path = self._trajectory
        x = min(t / path.dt, len(path.q) - 1.0)
        k = min(int(x), len(path.q) - 2)
        if k < 0 or x >= len(path.q) - 1:
            return path.q[-1], np.zeros(path.q.shape[1])
        f = x - k
        return path.q[k] * (1 - f) + path.q[k + 1] * f, path.dq[k] * (1 - f) + path.dq[k + 1] * f

    def finish_if_done(self, q: Array, dq: Array) -> None:
        """End once the arm rests where the motion leads, or has had time to."""
        self._still = self._still + 1 if float(np.abs(dq).max()) < REST_SPEED else 0
        if self._braking is not None:
            if self._elapsed - self._braking[3] >= self._braking[2] and self._still >= REST_STEPS:
                self.end(False, "cancelled")
            return
        over = self._elapsed - self._trajectory.duration
        if over < 0:
            return
        error = float(np.abs(q - self._trajectory.q[-1]).max())
        if error < GOAL_TOLERANCE and self._still >= REST_STEPS:
            self.end(True, "reached")
        elif over > SETTLE_TIME:
            self.end(False, f"not at the goal: {error:.3f} rad away (allowed {GOAL_TOLERANCE})")

    def end(self, reached: bool, reason: str) -> None:
        """Settle the result."""
        q = np.array(
            [s[0] for s in self._world.client.getJointStates(self._world.robot.body, self._world.robot.joints)]
        )
        self._result = MotionResult(reached, reason, float(np.abs(q - self._trajectory.q[-1]).max()))
        self._arm.finished(self)
