"""Configurations at a grasp, over the arm's redundancy and both antipodal flips, that touch nothing there."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.geometry import T_GRASP_FLIPPED, Array
from evg_app.motion.collision import ArmChecker
from evg_app.motion.franka_ik import BRANCHES
from evg_app.motion.kinematics import Q7_SAMPLES, Integers, hand_of_grasp
from evg_app.motion.scene import Scene
from evg_app.motion.times import Times
from evg_app.types import Verdict

FIRST_BATCH = 4
"""Configurations that are looked at first; the others only when none of these will do."""


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
class Candidates:
    """Configurations at the grasp: q (K, 7), branch and flip (K,)."""

    q: Array
    branch: Integers
    flip: Integers

    def only(self, rows: Integers | slice) -> "Candidates":
        """Some of them."""
        return Candidates(self.q[rows], self.branch[rows], self.flip[rows])


def flipped(T_base_grasp: Array) -> tuple[Array, Array]:
    """A grasp and its antipodal twin, (4, 4) each."""
    return T_base_grasp, T_base_grasp @ T_GRASP_FLIPPED


def free_at_grasp(
    robot: RobotConfig,
    checker: ArmChecker,
    scene: Scene,
    T_base_grasp: Array,
    q_reference: Array,
    effort: Effort = QUICK,
) -> Iterator[Candidates] | Verdict:
    """The chosen configurations at the grasp where the arm touches nothing, or the reason for none.

    In two batches, the most promising ones first; the second is only judged when it is asked for.
    """
    every = at_grasp(robot, checker, T_base_grasp, q_reference, effort)
    if isinstance(every, Verdict):
        return every
    reason = Verdict.SELF_COLLISION
    batches = (_free(checker, scene, batch) for batch in every)
    for free in batches:
        if not isinstance(free, Verdict):
            return chain([free], (more for more in batches if not isinstance(more, Verdict)))
        reason = free if reason is Verdict.SELF_COLLISION else reason
    return reason


def _free(checker: ArmChecker, scene: Scene, c: Candidates) -> Candidates | Verdict:
    """Those of some candidates that touch neither themselves nor the scene."""
    free = [k for k, q in enumerate(c.q) if not checker.self_collision.collides(q)]
    if not free:
        return Verdict.SELF_COLLISION
    c = c.only(np.array(free))
    clear = np.flatnonzero(~checker.hits_scene(c.q, scene, gripper=False))
    return c.only(clear) if len(clear) else Verdict.ARM_COLLISION


def at_grasp(
    robot: RobotConfig, checker: ArmChecker, T_base_grasp: Array, reference: Array, effort: Effort
) -> Iterator[Candidates] | Verdict:
    """A diverse choice of the solutions of both flips, those of the quickest cycle first, or the reason for none.

    The first `FIRST_BATCH`, and then, chosen when they are asked for, the others.
    """
    kinematics = checker.kinematics
    near = np.clip(reference[6], kinematics.lower[6], kinematics.upper[6])
    q7 = np.append(np.linspace(kinematics.lower[6], kinematics.upper[6], effort.q7_samples), near)
    poses = hand_of_grasp(robot, np.stack(flipped(T_base_grasp)))
    found = kinematics.closed_form(np.repeat(poses, len(q7), axis=0), np.tile(q7, 2))
    row, branch = np.nonzero(kinematics.inside_limits(found))
    if len(row) == 0:
        return Verdict.JOINT_LIMIT if np.isfinite(found).all(axis=-1).any() else Verdict.IK
    q, flip = found[row, branch], row // len(q7)
    order = np.argsort(Times.of(robot, reference).through(kinematics, q), kind="stable")
    chosen = islice(_diverse(order, flip * BRANCHES + branch, q[:, 6], effort.q7_apart), effort.candidates)
    found_all = Candidates(q, branch, flip)
    batches = (list(islice(chosen, count)) for count in (FIRST_BATCH, None))
    return (found_all.only(np.array(batch)) for batch in batches if batch)


def _diverse(order: Integers, group: Integers, turn: Array, apart: float) -> Iterator[int]:
    """Of `order` those whose turn differs more than `apart` from all before them of the same group."""
    taken: dict[int, list[float]] = {}
    for k in order.tolist():
        others, mine = taken.setdefault(int(group[k]), []), float(turn[k])
        if all(abs(other - mine) > apart for other in others):
            others.append(mine)
            yield k
