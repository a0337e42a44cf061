"""About how long motions take, without planning them: what executions of a grasp are ranked by."""

from dataclasses import dataclass

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.geometry import Array
from evg_app.motion.kinematics import LIMIT_WEIGHT, Kinematics
from evg_app.motion.verify import limits


@dataclass(frozen=True)
class Times:
    """The poses that a cycle passes through, and how fast joints are.

    Attributes:
        start, drop, look: where the arm is, the drop pose, the look pose. Shape (7,) [rad].
        velocity, acceleration: shape (7,) [rad/s], [rad/s^2].
        carry: share of the limits that is used with an object in the hand.
    """

    start: Array
    drop: Array
    look: Array
    velocity: Array
    acceleration: Array
    carry: float

    @staticmethod
    def of(robot: RobotConfig, q_start: Array) -> "Times":
        """For a robot that begins its cycle at q_start (7,)."""
        velocity, acceleration, _ = limits(robot)
        drop, look = np.asarray(robot.drop.q_rad), np.asarray(robot.look_q_rad)
        return Times(q_start, drop, look, velocity, acceleration, robot.limits.carry_scale)

    def between(self, a: Array, b: Array, share: float = 1.0) -> Array:
        """From rest to rest on straight joint paths, jerk ignored. Shapes (..., 7) -> (...) [s]."""
        way, v, a_max = np.abs(b - a), self.velocity * share, self.acceleration * share
        ramps = way < v * v / a_max
        return np.asarray(np.where(ramps, 2 * np.sqrt(way / a_max), way / v + v / a_max).max(axis=-1))

    def along(self, leg: Array, share: float = 1.0) -> float:
        """Along configurations (K, 7) that are followed exactly [s]; near a singularity joints turn far."""
        far = np.abs(np.diff(leg, axis=0)).sum(axis=0)
        return float(self.between(np.zeros_like(far), far, share))

    def through(self, kinematics: Kinematics, q: Array) -> Array:
        """From the start to q (..., 7) and on to the drop pose; plus closeness to limits [s]. Shape (...)."""
        closeness = np.abs(2 * (q - kinematics.middle) / (kinematics.upper - kinematics.lower)).max(axis=-1)
        cycle = self.between(self.start, q) + self.between(q, self.drop, self.carry)
        return np.asarray(cycle + LIMIT_WEIGHT * closeness**4)

    def of_leg(self, kinematics: Kinematics, approach: Array, lift: Array) -> float:
        """Reach, approach, lift, transport to the drop pose and back to the look pose; plus closeness to limits [s]."""
        whole = np.concatenate([approach, lift])
        closeness = np.abs(2 * (whole - kinematics.middle) / (kinematics.upper - kinematics.lower)).max()
        cycle = self.between(self.start, approach[0]) + self.along(approach) + self.along(lift, self.carry)
        cycle += self.between(lift[-1], self.drop, self.carry) + self.between(self.drop, self.look)
        return float(cycle + LIMIT_WEIGHT * closeness**4)
