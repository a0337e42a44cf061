"""Label grasps of one scene: does the approach stay free, and does the closed gripper hold? (learning.md §1)."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import Array
from evg_app.learning.candidates import along_normals, from_contacts, perturbed, turned
from evg_app.learning.holds import check_holds
from evg_app.learning.solids import CLOSE, FREE, SceneSolids
from evg_app.learning.surface import SurfacePoints


class Kind(IntEnum):
    """What a labelled grasp is."""

    COLLISION = 0
    SLIP = 1
    POSITIVE = 2


class WithContact(IntEnum):
    """Whether a grasp holds when its approach may touch something: the fingers then close where it stopped."""

    FAILS = 0
    HOLDS = 1
    UNKNOWN = 2


RETREAT_STEP, RETREATS = 0.004, 10
"""Where a colliding approach stops is looked for in steps of [m], so many at most."""
TOUCH_GAP = 0.0015
"""Physics reports a contact at gaps up to this [m] (learning.md §1)."""


@dataclass(frozen=True)
class LabelledGrasps:
    """Grasps with their truth.

    Attributes:
        T_task_grasp: [m]. Shape (N, 4, 4).
        kind: see `Kind`. Shape (N,), uint8.
        width: opening of the gripper when it holds [m] (0.08 otherwise). Shape (N,).
        owner: object held, -1 for none. Shape (N,).
    """

    T_task_grasp: Array
    kind: NDArray[np.uint8]
    width: Array
    owner: NDArray[np.int64]

    def take(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> "LabelledGrasps":
        """The grasps at `index`."""
        return LabelledGrasps(self.T_task_grasp[index], self.kind[index], self.width[index], self.owner[index])

    def join(self, other: "LabelledGrasps") -> "LabelledGrasps":
        """These grasps followed by the others."""
        return LabelledGrasps(
            np.concatenate([self.T_task_grasp, other.T_task_grasp]),
            np.concatenate([self.kind, other.kind]),
            np.concatenate([self.width, other.width]),
            np.concatenate([self.owner, other.owner]),
        )


def judge(scene: SceneSolids, T_task_grasp: Array) -> tuple[LabelledGrasps, NDArray[np.bool_]]:
    """Judge poses (N, 4, 4), and say which are sure (N,): the others are too close to call."""
    n = len(T_task_grasp)
    clearance = scene.clearance(T_task_grasp)
    sure = clearance <= CLOSE
    free = np.flatnonzero(clearance >= FREE)
    kind, width, owner = np.full(n, Kind.COLLISION, dtype=np.uint8), np.full(n, 0.08), np.full(n, -1, dtype=np.int64)
    hold = check_holds(scene, T_task_grasp[free])
    kind[free] = np.where(hold.holds, Kind.POSITIVE, Kind.SLIP)
    width[free], owner[free] = np.where(hold.holds, hold.width, 0.08), hold.owner
    sure[free] = hold.holds | hold.slips
    return LabelledGrasps(T_task_grasp, kind, width, owner), sure


def label(scene: SceneSolids, T_task_grasp: Array) -> LabelledGrasps:
    """Judge poses (N, 4, 4); those too close to call are left out. Returns at most N grasps."""
    judged, sure = judge(scene, T_task_grasp)
    return judged.take(sure)


def with_contact(scene: SceneSolids, grasps: LabelledGrasps) -> NDArray[np.uint8]:
    """What each of the grasps does when touching is allowed, see `WithContact`. Shape (N,), uint8.

    A colliding hand is moved back along its approach until it is free; there the fingers close.
    """
    answer = np.where(grasps.kind == Kind.POSITIVE, WithContact.HOLDS, WithContact.FAILS).astype(np.uint8)
    waiting = np.flatnonzero(grasps.kind == Kind.COLLISION)
    T = grasps.T_task_grasp[waiting].copy()
    for _ in range(RETREATS):
        if len(waiting) == 0:
            break
        T[:, :3, 3] -= RETREAT_STEP * T[:, :3, 2]
        free = scene.clearance(T) > TOUCH_GAP
        hold = check_holds(scene, T[free])
        unknown = np.where(hold.slips, WithContact.FAILS, WithContact.UNKNOWN)
        answer[waiting[free]] = np.where(hold.holds, WithContact.HOLDS, unknown)
        waiting, T = waiting[~free], T[~free]
    return answer


def sample_and_label(
    scene: SceneSolids, points: SurfacePoints, candidates: int, rng: np.random.Generator
) -> LabelledGrasps:
    """Label about `candidates` grasps of a scene, 70 % from contacts and 30 % along normals; then a third as many
    again near positives, and a twelfth as many positives turned about their approach."""
    contacts = points.take(rng.integers(len(points.position), size=round(0.7 * candidates)))
    normals = points.take(rng.integers(len(points.position), size=round(0.3 * candidates)))
    first = label(scene, np.concatenate([from_contacts(scene, contacts, rng), along_normals(normals, rng)]))
    positives = first.T_task_grasp[first.kind == Kind.POSITIVE]
    if len(positives) == 0:
        return first
    around = [perturbed(positives, candidates // 3, rng), turned(positives, candidates // 12, rng)]
    return first.join(label(scene, np.concatenate(around)))


def balance(grasps: LabelledGrasps, each: int, slip_share: float, rng: np.random.Generator) -> LabelledGrasps:
    """At most `each` positives, spread over the objects, and as many negatives.

    `slip_share` of the negatives are slips where there are enough.
    """
    positive, slip, collision = (
        rng.permutation(np.flatnonzero(grasps.kind == kind)) for kind in (Kind.POSITIVE, Kind.SLIP, Kind.COLLISION)
    )
    positive = _spread(positive, grasps.owner, each)
    wanted = max(len(positive), min(each, 40))
    slip = slip[: max(round(slip_share * wanted), wanted - len(collision))]
    collision = collision[: wanted - len(slip)]
    return grasps.take(np.sort(np.concatenate([positive, slip, collision])))


def _spread(index: NDArray[np.int64], owner: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """The first `count` of `index` when every object takes turns."""
    if len(index) == 0:
        return index
    turn = np.zeros(len(index), dtype=np.int64)
    for one in np.unique(owner[index]):
        mine = owner[index] == one
        turn[mine] = np.arange(mine.sum())
    return index[np.argsort(turn, kind="stable")[:count]]
