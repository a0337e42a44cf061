"""A joint_trajectory_controller on a PyBullet arm, as strict as the real one; shares nothing with the driver."""

import itertools
import math

import numpy as np
import pybullet

LIMIT_MARGIN = 0.1
START_RAD, GOAL_RAD, PATH_RAD = 0.05, 0.01, 0.2
GOAL_TIME_S = 1.0


def refusal(message, names, q_now) -> str:
    """Why a trajectory_msgs/JointTrajectory is not taken, empty when it is."""
    if list(message.joint_names) != list(names):
        return f"joint names {list(message.joint_names)} are not {list(names)} in this order"
    if not message.points:
        return "no points"
    times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in message.points]
    if times[0] < 0 or any(b <= a for a, b in itertools.pairwise(times)):
        return "time does not go forward"
    for point in message.points:
        for values in (point.positions, point.velocities, point.accelerations):
            if len(values) not in (0, len(names)) or not all(map(math.isfinite, values)):
                return "a point has the wrong length or is not finite"
        if len(point.positions) != len(names):
            return "a point has no positions"
    first, last = message.points[0], message.points[-1]
    if times[0] == 0 and first.velocities and np.abs(first.velocities).max() > 1e-6:
        return "it starts with a velocity"
    if times[0] == 0 and np.abs(np.asarray(first.positions) - q_now).max() > START_RAD:
        return "it starts elsewhere"
    if last.velocities and np.abs(last.velocities).max() > 1e-6:
        return "it ends with a velocity"
    return ""


class Controller:
    """Follows one trajectory, holds otherwise."""

    def __init__(self, world):
        self.world = world
        self.active = True
        self.frozen = False
        self.hold = self.joints()[0]
        self._t = self._q = self._v = None
        self.elapsed = 0.0
        self.outcome = None
        world.before_step.append(self.act)
        world.on_reset.append(self.reset)

    def reset(self):
        self.drop("the world was reset")
        self.hold = self.joints()[0]

    def joints(self):
        states = self.world.client.getJointStates(self.world.robot.body, self.world.robot.joints)
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    @property
    def busy(self):
        return self._t is not None

    def start(self, message):
        q = self.joints()[0]
        t = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in message.points])
        positions = np.array([list(p.positions) for p in message.points])
        velocities = np.array([list(p.velocities) or [0.0] * len(q) for p in message.points])
        if t[0] > 0:
            t = np.concatenate([[0.0], t])
            positions = np.vstack([q, positions])
            velocities = np.vstack([self.joints()[1], velocities])
        self._t, self._q, self._v = t, positions, velocities
        self.elapsed, self.outcome = 0.0, None

    def drop(self, reason):
        """Stop where the arm is and hold."""
        if self.busy:
            self.outcome = (False, -4 if "tolerance" in reason else 0, reason)
        self._t = None
        self.hold = self.joints()[0]

    def _sample(self, t):
        if t >= self._t[-1]:
            return self._q[-1], np.zeros(self._q.shape[1])
        k = int(np.searchsorted(self._t, t, side="right")) - 1
        h = self._t[k + 1] - self._t[k]
        s = (t - self._t[k]) / h
        q0, q1, v0, v1 = self._q[k], self._q[k + 1], self._v[k] * h, self._v[k + 1] * h
        c2, c3 = 3 * (q1 - q0) - 2 * v0 - v1, 2 * (q0 - q1) + v0 + v1
        q = q0 + s * (v0 + s * (c2 + s * c3))
        dq = (v0 + s * (2 * c2 + 3 * s * c3)) / h
        return q, dq

    def act(self):
        target, speed = self.hold, np.zeros(len(self.hold))
        if self.busy and not self.frozen:
            self.elapsed += 1.0 / 240.0
            target, speed = self._sample(self.elapsed)
            self.hold = target
        robot = self.world.robot
        self.world.client.setJointMotorControlArray(
            robot.body,
            robot.joints,
            pybullet.POSITION_CONTROL,
            targetPositions=target,
            targetVelocities=speed,
            forces=robot.efforts,
            positionGains=[0.3] * len(target),
            velocityGains=[1.0] * len(target),
        )
        if self.busy and not self.frozen:
            self._judge(target)

    def _judge(self, target):
        q = self.joints()[0]
        if np.abs(q - target).max() > PATH_RAD:
            self.drop("path tolerance violated")
            return
        over = self.elapsed - self._t[-1]
        gap = np.abs(q - self._q[-1]).max()
        if over >= 0 and gap < GOAL_RAD:
            self._t, self.outcome = None, (True, 0, "")
        elif over > GOAL_TIME_S:
            self._t, self.outcome = None, (False, -5, f"goal tolerance violated by {gap:.3f} rad")
