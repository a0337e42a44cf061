"""Carrying: what the held object may not touch on lift and transport, how level the hand stays, where it drops."""

from dataclasses import dataclass

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.geometry import Array, rotation_about
from evg_app.motion.held import RIM_CLEARANCE, Held
from evg_app.motion.kinematics import Flags, Kinematics

CONTACT_LIFT = 0.03
"""Over this much of the lift the object may touch what stood beside it [m]."""
LEAVING = (0.001, 0.001, 0.008)
"""Spheres that begin in contact may come this much closer to table, boxes, seen things [m]: the last are coarse."""
SEEN_SLACK = 0.005
"""How deep a sphere may enter seen things [m]: spheres stick out of the object by more."""
TILT = np.deg2rad(15.0)
"""How much further than the tilt between both ends the hand may tilt on the way [rad]."""
DIP = 0.03
"""How far the hand may go below the lower one of both ends [m]."""
EPS = 1e-3
"""Added to the height of a raised drop pose [m]."""


@dataclass(frozen=True)
class Carry:
    """A check of the hand's poses while it holds something.

    Attributes:
        held: spheres in the hand's frame.
        allowed: least distances of the spheres' centres from table, boxes, seen things: the radius, or less where a
            sphere begins in contact, which it may leave. Shape (3, S) [m].
        start: where the hand begins [m]. Shape (3,).
        blind: within this distance from the start, contact with seen things is tolerated [m].
        axis: approach axis at the start. Shape (3,).
        cosine: of the largest angle between approach axis and `axis`.
        floor: least height of the hand's origin in the base frame [m].
    """

    held: Held
    allowed: Array
    start: Array
    blind: float
    axis: Array
    cosine: float
    floor: float

    @staticmethod
    def lift(held: Held, T_start: Array) -> "Carry":
        """For a lift from the hand pose (4, 4)."""
        return Carry(held, _allowed(held, T_start), T_start[:3, 3], CONTACT_LIFT, T_start[:3, 2], -1.0, -np.inf)

    @staticmethod
    def transport(held: Held, T_start: Array, T_goal: Array) -> "Carry":
        """For a transport between hand poses (4, 4): neither dipping nor tilting more than its ends ask for."""
        angle = float(np.arccos(np.clip(T_start[:3, 2] @ T_goal[:3, 2], -1.0, 1.0)))
        cosine = float(np.cos(min(angle + TILT, np.pi)))
        floor = float(min(T_start[2, 3], T_goal[2, 3])) - DIP
        return Carry(held, _allowed(held, T_start), T_start[:3, 3], 0.0, T_start[:3, 2], cosine, floor)

    def hits(self, T_base_hand: Array) -> Flags:
        """Which hand poses (N, 4, 4) are not allowed. Shape (N,)."""
        position = T_base_hand[:, :3, 3]
        hits: Flags = (position[:, 2] < self.floor) | (T_base_hand[:, :3, 2] @ self.axis < self.cosine - 1e-9)
        if hits.all() or len(self.held.radius) == 0:
            return hits
        touches: Flags = np.any(self.held.clearance(T_base_hand) < self.allowed[:, None], axis=2)
        touches[2] &= np.linalg.norm(position - self.start, axis=1) >= self.blind
        return np.asarray(hits | touches.any(axis=0))


def _allowed(held: Held, T_start: Array) -> Array:
    clearance = held.clearance(T_start[None])[:, 0]
    wanted = held.radius - np.array([0.0, 0.0, SEEN_SLACK])[:, None]
    allowed: Array = np.minimum(wanted, clearance - np.array(LEAVING)[:, None])
    return allowed


def drop_goals(robot: RobotConfig, kinematics: Kinematics, held: Held, lifted_q: Array, tip: float) -> list[Array]:
    """Configurations above the bin from which the object can be let go, the one first that costs the least time.

    The finger tips are where the configured drop pose has them, or straight above, so high that the object clears the
    rim; the hand has the orientation of the drop pose, or the one of the lift turned about the vertical.

    Args:
        robot: for bin and drop pose.
        kinematics: of the arm.
        held: spheres in the hand's frame.
        lifted_q: end of the lift. Shape (7,).
        tip: from the hand's origin to the finger tips [m].
    """
    drop_q = np.asarray(robot.drop.q_rad)
    T_lifted, T_drop = kinematics.fk_hand(lifted_q), kinematics.fk_hand(drop_q)
    tips = T_drop[:3, 3] + tip * T_drop[:3, 2]
    turn = np.arctan2(tips[1], tips[0]) - np.arctan2(T_lifted[1, 3], T_lifted[0, 3])
    T_level = rotation_about("z", float(turn)) @ T_lifted
    goals: list[Array] = []
    for T, reference, q7 in ((T_drop, drop_q, drop_q[6:7]), (T_level, lifted_q, None)):
        T[:3, 3] = tips - tip * T[:3, 2]
        raise_by = _rim_height(robot, held) - held.lowest(T)
        if T is T_drop and raise_by <= 0:
            goals.append(drop_q)
            continue
        T[2, 3] += max(raise_by + EPS, 0.0)
        goals += list(kinematics.search(T, reference, q7).q[:1])
    look_q = np.asarray(robot.look_q_rad)

    def time_of(goal: Array) -> float:
        return float(sum((np.abs(goal - q) / kinematics.speed).max() for q in (lifted_q, look_q)))

    return sorted(goals, key=time_of)


def _rim_height(robot: RobotConfig, held: Held) -> float:
    """Height over the table that the object's lowest point needs [m]."""
    x, y, z = robot.drop.bin_center_m
    return float(held.table.height(np.array([x, y, z + robot.drop.bin_size_m[2]]))) + RIM_CLEARANCE
