"""The straight parts of a pick, approach and lift, over the arm's redundancy and both antipodal flips."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.geometry import T_GRASP_FLIPPED, Array
from evg_app.motion.collision import ArmChecker
from evg_app.motion.kinematics import Q7_SAMPLES, Integers, Kinematics, hand_of_grasp
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
class Effort:
    """How closely a grasp is looked at.

    Attributes:
        q7_samples: values of the free joint.
        q7_apart: candidates of the same branch differ at least this much in q7 [rad].
        candidates: configurations at the grasp that are followed.
        fixed_q7: whether legs with q7 held are tried beside those of least motion.
    """

    q7_samples: int
    q7_apart: float
    candidates: int
    fixed_q7: bool


QUICK = Effort(Q7_SAMPLES, 0.25, 24, False)
"""For every grasp."""
THOROUGH = Effort(4 * Q7_SAMPLES, 0.05, 120, True)
"""Before a decision ends without a pick."""


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


@dataclass(frozen=True)
class Candidates:
    """Configurations at the grasp: q (K, 7), branch, flip and cost (K,)."""

    q: Array
    branch: Integers
    flip: Integers
    cost: Array


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
) -> list[Leg] | Verdict:
    """Straight executions of a grasp that begin where the arm is free of collision, cheapest first, or why none.

    The gripper itself on these legs is not checked here (see `gripper.py`).
    """
    candidates = free_at_grasp(robot, checker, scene, T_base_grasp, q_reference, effort)
    if isinstance(candidates, Verdict):
        return candidates
    return _straight(robot, checker, T_base_grasp, candidates, q_reference, effort)


def free_at_grasp(
    robot: RobotConfig,
    checker: ArmChecker,
    scene: Scene,
    T_base_grasp: Array,
    q_reference: Array,
    effort: Effort = QUICK,
) -> Candidates | Verdict:
    """The chosen configurations at the grasp where the arm touches nothing, cheapest first, or the reason for none."""
    candidates = _at_grasp(robot, checker, T_base_grasp, q_reference, effort)
    if isinstance(candidates, Verdict):
        return candidates
    free = [k for k in range(len(candidates.q)) if not checker.self_collision.collides(candidates.q[k])]
    if not free:
        return Verdict.SELF_COLLISION
    candidates = _only(candidates, np.array(free))
    clear = ~checker.hits_scene(candidates.q, scene, gripper=False)
    if not clear.any():
        return Verdict.ARM_COLLISION
    return _only(candidates, np.flatnonzero(clear))


def _only(c: Candidates, rows: Integers) -> Candidates:
    return Candidates(c.q[rows], c.branch[rows], c.flip[rows], c.cost[rows])


def _flipped(T_base_grasp: Array) -> tuple[Array, Array]:
    return T_base_grasp, T_base_grasp @ T_GRASP_FLIPPED


def _at_grasp(
    robot: RobotConfig, checker: ArmChecker, T_base_grasp: Array, reference: Array, effort: Effort
) -> Candidates | Verdict:
    """A diverse choice of the solutions of both flips, cheapest first."""
    kinematics = checker.kinematics
    near = np.clip(reference[6], kinematics.lower[6], kinematics.upper[6])
    q7 = np.append(np.linspace(kinematics.lower[6], kinematics.upper[6], effort.q7_samples), near)
    found = [kinematics.search(hand_of_grasp(robot, T), reference, q7) for T in _flipped(T_base_grasp)]
    if not any(len(f.q) for f in found):
        return Verdict.JOINT_LIMIT if any(f.any_without_limits for f in found) else Verdict.IK
    q, branch = np.concatenate([f.q for f in found]), np.concatenate([f.branch for f in found])
    flip = np.repeat([0, 1], [len(f.q) for f in found])
    cost = np.concatenate([f.cost for f in found])
    chosen: list[int] = []
    for k in np.argsort(cost, kind="stable"):
        same = [c for c in chosen if branch[c] == branch[k] and flip[c] == flip[k]]
        if all(abs(q[c, 6] - q[k, 6]) > effort.q7_apart for c in same):
            chosen.append(int(k))
        if len(chosen) == effort.candidates:
            break
    return _only(Candidates(q, branch, flip, cost), np.array(chosen))


def _straight(
    robot: RobotConfig, checker: ArmChecker, T_base_grasp: Array, c: Candidates, q_reference: Array, effort: Effort
) -> list[Leg] | Verdict:
    """Follow approach and lift with each candidate; those that stay solvable, smooth and inside the limits."""
    kinematics = checker.kinematics
    twins = _flipped(T_base_grasp)
    backwards = np.stack([hand_of_grasp(robot, approach_poses(robot, T)[::-1]) for T in twins])
    upwards = np.stack([hand_of_grasp(robot, lift_poses(robot, T)) for T in twins])
    back, up = (track(kinematics, c.q, poses[c.flip]) for poses in (backwards, upwards))
    flips = c.flip
    if effort.fixed_q7:
        held = [_with_q7_held(kinematics, c, poses) for poses in (backwards, upwards)]
        back, up, flips = np.concatenate([back, held[0]]), np.concatenate([up, held[1]]), np.tile(c.flip, 2)
    times = Times.of(robot, q_reference)
    legs: list[Leg] = []
    reason = Verdict.IK
    for k in range(len(back)):
        approach, lift = back[k, ::-1], up[k]
        whole = np.concatenate([approach, lift])
        if not np.isfinite(whole).all():
            continue
        if not kinematics.inside_limits(whole).all():
            reason = Verdict.JOINT_LIMIT
        elif max(np.abs(np.diff(leg, axis=0)).max() for leg in (approach, lift)) < MAX_JUMP:
            flip = bool(flips[k])
            legs.append(Leg(twins[int(flip)], flip, approach, lift, times.of_leg(kinematics, approach, lift)))
    return sorted(legs, key=lambda leg: leg.cost) or reason


def _with_q7_held(kinematics: Kinematics, c: Candidates, poses: Array) -> Array:
    """From the grasp along the poses of each flip (2, K, 4, 4). Shape (C, K, 7)."""
    path = np.full((len(c.q), poses.shape[1], 7), np.nan)
    for flip in (0, 1):
        rows = np.flatnonzero(c.flip == flip)
        if len(rows):
            path[rows] = kinematics.follow(poses[flip], c.q[rows, 6], c.branch[rows])
    return path
