"""The straight parts of a pick, approach and lift, over the arm's redundancy and both antipodal flips."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.geometry import Array
from evg_app.motion.candidates import QUICK, Candidates, Effort, flipped, free_at_grasp
from evg_app.motion.collision import ArmChecker
from evg_app.motion.kinematics import Kinematics, hand_of_grasp
from evg_app.motion.path import JointPath, bezier_lift, through
from evg_app.motion.scene import Scene
from evg_app.motion.times import Times
from evg_app.motion.track import track
from evg_app.types import Verdict

CARTESIAN_STEP = 0.005
"""Distance between inverse kinematics along a straight leg [m]."""
MAX_JUMP = 0.15
"""Largest joint step between two of them [rad]; more is a jump to another solution or a singularity."""
BACK_OFF = 0.05
"""How far a steep grasp backs off along its approach before it goes straight up [m]."""
STEEP = 0.5
"""Grasps whose approach is within 60 degrees of straight down are steep: cosine of that angle."""


@dataclass(frozen=True)
class Leg:
    """One way to execute a grasp: pre-grasp to grasp, and grasp to lifted.

    Attributes:
        T_base_grasp: flip included. Shape (4, 4).
        flipped: whether it is the antipodal twin.
        approach_q, lift_q: configurations along both straight parts. Shape (K, 7) [rad].
        cost: about how long the whole cycle takes, and closeness to limits [s].
    """

    T_base_grasp: Array
    flipped: bool
    approach_q: Array
    lift_q: Array
    cost: float

    @cached_property
    def approach(self) -> JointPath:
        """Pre-grasp to grasp."""
        return through(self.approach_q)

    @cached_property
    def lift(self) -> JointPath:
        """Grasp to lifted."""
        return through(self.lift_q)


def approach_poses(robot: RobotConfig, T_base_grasp: Array) -> Array:
    """Grasp poses from the pre-grasp to the grasp along the approach. Shape (K, 4, 4)."""
    count = int(np.ceil(robot.pregrasp_m / CARTESIAN_STEP)) + 1
    poses = np.tile(T_base_grasp, (count, 1, 1))
    poses[:, :3, 3] -= np.linspace(robot.pregrasp_m, 0.0, count)[:, None] * T_base_grasp[:3, 2]
    return poses


def lift_poses(robot: RobotConfig, T_base_grasp: Array) -> Array:
    """Grasp poses from the grasp to the lifted pose; a steep grasp first backs off along its approach. (K, 4, 4)."""
    approach = T_base_grasp[:3, 2]
    back_off = BACK_OFF if -approach[2] > STEEP else 0.0
    count = int(np.ceil((robot.lift_m + back_off) / CARTESIAN_STEP)) + 1
    poses = np.tile(T_base_grasp, (count, 1, 1))
    poses[:, :3, 3] = bezier_lift(T_base_grasp[:3, 3], approach, robot.lift_m, back_off, count)
    return poses


def find_legs(
    robot: RobotConfig,
    checker: ArmChecker,
    scene: Scene,
    T_base_grasp: Array,
    q_reference: Array,
    effort: Effort = QUICK,
) -> Iterator[Leg] | Verdict:
    """Straight executions of a grasp that begin where the arm is free of collision, or why there is none.

    They come in batches: those of the most promising configurations first, in each the cheapest first. Later batches
    are only computed when they are asked for. The gripper itself on these legs is not checked here (see `gripper.py`).
    """
    candidates = free_at_grasp(robot, checker, scene, T_base_grasp, q_reference, effort)
    if isinstance(candidates, Verdict):
        return candidates
    reason = Verdict.IK
    batches = (_straight(robot, checker, T_base_grasp, batch, q_reference, effort) for batch in candidates)
    for legs in batches:
        if not isinstance(legs, Verdict):
            return chain(legs, chain.from_iterable(more for more in batches if not isinstance(more, Verdict)))
        reason = legs if reason is Verdict.IK else reason
    return reason


def _straight(
    robot: RobotConfig, checker: ArmChecker, T_base_grasp: Array, c: Candidates, q_reference: Array, effort: Effort
) -> list[Leg] | Verdict:
    """Follow approach and lift with each candidate; those that stay solvable, smooth and inside the limits."""
    kinematics = checker.kinematics
    twins = flipped(T_base_grasp)
    backwards = np.stack([hand_of_grasp(robot, approach_poses(robot, T)[::-1]) for T in twins])
    upwards = np.stack([hand_of_grasp(robot, lift_poses(robot, T)) for T in twins])
    back, up = (track(kinematics, c.q, poses[c.flip]) for poses in (backwards, upwards))
    flips = c.flip
    if effort.fixed_q7:
        held = [_with_q7_held(kinematics, c, poses) for poses in (backwards, upwards)]
        back, up, flips = np.concatenate([back, held[0]]), np.concatenate([up, held[1]]), np.tile(c.flip, 2)
    whole = np.concatenate([back[:, ::-1], up], axis=1)
    solved = np.isfinite(whole).all(axis=(1, 2))
    inside = kinematics.inside_limits(whole).all(axis=1)
    jump = [np.abs(np.diff(leg, axis=1)).max(axis=(1, 2)) for leg in (back, up)]
    good = np.flatnonzero(solved & inside & (np.maximum(*jump) < MAX_JUMP))
    if len(good) == 0:
        return Verdict.JOINT_LIMIT if (solved & ~inside).any() else Verdict.IK
    times, n = Times.of(robot, q_reference), back.shape[1]
    legs = []
    for k in good:
        flip, approach, lift = bool(flips[k]), whole[k, :n], whole[k, n:]
        legs.append(Leg(twins[int(flip)], flip, approach, lift, times.of_leg(kinematics, approach, lift)))
    return sorted(legs, key=lambda leg: leg.cost)


def _with_q7_held(kinematics: Kinematics, c: Candidates, poses: Array) -> Array:
    """From the grasp along the poses of each flip (2, K, 4, 4). Shape (C, K, 7)."""
    path = np.full((len(c.q), poses.shape[1], 7), np.nan)
    for flip in (0, 1):
        rows = np.flatnonzero(c.flip == flip)
        if len(rows):
            path[rows] = kinematics.follow(poses[flip], c.q[rows, 6], c.branch[rows])
    return path
