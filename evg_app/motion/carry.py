"""Carrying: what the held object may not touch on lift and transport, how level the hand stays, where it drops."""

from dataclasses import dataclass, replace

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.geometry import Array, rotation_about
from evg_app.motion.held import RIM_CLEARANCE, Held
from evg_app.motion.kinematics import Flags, Kinematics
from evg_app.motion.links import LinkCapsules
from evg_app.motion.spheres import CORNERS

CONTACT_LIFT = 0.03
"""Over this much of the lift the object may touch what stood beside it [m]."""
LEAVING = (0.001, 0.001, 0.008)
"""Spheres that begin in contact may come this much closer to table, boxes, seen things [m]: the last are coarse."""
SEEN_SLACK = 0.005
"""How deep a sphere may enter seen things [m]: spheres stick out of the object by more."""
ARM_CLEARANCE = 0.01
"""Clearance of the held object from the arm's own links [m]."""
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
        links: the arm's own links, or None when they are not checked.
        arm_allowed: least distances of the spheres' centres from them [m], like `allowed`. Shape (S,).
    """

    held: Held
    allowed: Array
    start: Array
    blind: float
    axis: Array
    cosine: float
    floor: float
    links: LinkCapsules | None = None
    arm_allowed: Array | None = None

    def beside(self, links: LinkCapsules, frames: Array, T_base_hand: Array) -> "Carry":
        """The same with the arm's own links checked too; where the carry begins, frames (8, 4, 4) and hand (4, 4)."""
        gap = links.gap(frames[None], self.held.placed(T_base_hand[None]))[0]
        allowed = np.minimum(self.held.radius + ARM_CLEARANCE, gap - LEAVING[0])
        return replace(self, links=links, arm_allowed=allowed)

    def hits_arm(self, frames: Array, T_base_hand: Array) -> Flags:
        """Where the object touches the arm, for frames (N, 8, 4, 4) and hands (N, 4, 4). Shape (N,)."""
        hits = np.zeros(len(frames), dtype=np.bool_)
        if self.links is None or self.arm_allowed is None or len(self.held.radius) == 0:
            return hits
        middle = self.held.center.mean(axis=0)
        reach = float((np.linalg.norm(self.held.center - middle, axis=1) + self.arm_allowed).max())
        around = (T_base_hand[:, :3, :3] @ middle + T_base_hand[:, :3, 3])[:, None]
        near = np.flatnonzero(self.links.gap(frames, around)[:, 0] < reach)
        if len(near):
            gap = self.links.gap(frames[near], self.held.placed(T_base_hand[near]))
            hits[near] = (gap < self.arm_allowed).any(axis=1)
        return hits

    def moved(self, T_base_hand: Array) -> Array:
        """How far any point of the object moves at most between neighbours of hands (N, 4, 4). Shape (N - 1,) [m]."""
        if len(self.held.radius) == 0:
            return np.zeros(len(T_base_hand) - 1)
        low = (self.held.center - self.held.radius[:, None]).min(axis=0)
        high = (self.held.center + self.held.radius[:, None]).max(axis=0)
        corners = (low + high) / 2 + CORNERS * (high - low) / 2
        p = corners @ T_base_hand[:, :3, :3].transpose(0, 2, 1) + T_base_hand[:, None, :3, 3]
        return np.asarray(np.linalg.norm(np.diff(p, axis=0), axis=2).max(axis=1, initial=0.0))

    @staticmethod
    def lift(held: Held, T_start: Array) -> "Carry":
        """For a lift from the hand pose (4, 4)."""
        held = replace(held, field=held.beside)
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
    """Least distances of the spheres at the hand pose (4, 4); see `Carry.allowed`. Shape (3, S) [m]."""
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
        """To the goal and on to the look pose [s]."""
        return float(sum((np.abs(goal - q) / kinematics.speed).max() for q in (lifted_q, look_q)))

    return sorted(goals, key=time_of)


def _rim_height(robot: RobotConfig, held: Held) -> float:
    """Height over the table that the object's lowest point needs [m]."""
    x, y, z = robot.drop.bin_center_m
    return float(held.table.height(np.array([x, y, z + robot.drop.bin_size_m[2]]))) + RIM_CLEARANCE
