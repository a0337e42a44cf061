"""Free joint-space motion: straight, over a raised via-point, or by OMPL's RRT-Connect; always checked densely."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from evg_app.errors import Refused
from evg_app.geometry import Array
from evg_app.motion.carry import Carry
from evg_app.motion.collision import ArmChecker
from evg_app.motion.path import JointPath, blended, line, polyline
from evg_app.motion.scene import Scene
from evg_app.motion.search import search
from evg_app.motion.timing import fastest
from evg_app.motion.trajectory import limits

CHECK_STEP = 0.005
"""No point of the arm or of what it holds moves further than this between two checks [m]."""
SEARCH_STEP = 0.02
"""The same while a tree is searched; its result is then checked at `CHECK_STEP` [m]."""
COARSE, MOST_COARSE = 0.15, 15
"""The first pass looks at configurations this far apart [rad], at no more than so many steps."""
SLACK = 1.1
"""How many more checks are made than a constant speed along the path would need."""
RAISES = (0.08, 0.16, 0.26)
"""Heights of the via-points above start and goal [m]."""
INTERVALS = (8, 16, 32)
"""B-spline intervals that round the corners of a path; more stay closer to the checked polyline."""


@dataclass(frozen=True)
class Check:
    """What a path is checked against.

    Attributes:
        scene: prepared scene.
        gripper: whether hand and fingers count.
        radius: of each sphere [m]: smaller than its own for spheres that touch something at the very start, which
            may leave but not come closer. Shape (S,).
        carry: what the hand holds, if anything.
    """

    scene: Scene
    gripper: bool
    radius: Array
    carry: Carry | None = None


class Router:
    """Finds and checks joint paths. Pure: equal inputs give equal paths."""

    def __init__(self, checker: ArmChecker, via: tuple[Array, ...] = ()) -> None:
        """`via` are known good configurations (J,) to go through when the straight path is blocked."""
        self.checker, self.via = checker, via

    def check(self, scene: Scene, q_start: Array, gripper: bool = True) -> Check:
        """A check that lets the arm leave where it is."""
        clearance = self.checker.clearance(q_start, scene)
        radius = np.minimum(self.checker.body.radius, np.maximum(clearance - 1e-3, 0.0))
        return Check(scene, gripper, radius)

    def strict(self, scene: Scene, gripper: bool = True) -> Check:
        """A check with the spheres' own radii."""
        return Check(scene, gripper, self.checker.body.radius)

    def is_free(self, path: JointPath, check: Check, step: float = CHECK_STEP) -> bool:
        """Whether the whole path is inside the joint limits and free of collision, checked every `step` [m]."""
        return self._dense(path, lambda q, frames: self._free(q, frames, check), check.carry, step)

    def carry_hits(self, path: JointPath, carry: Carry) -> bool:
        """Whether a held object touches something on a path along which the arm was found free."""
        return not self._dense(path, lambda _, frames: not self._carry_hits(frames, carry), carry)

    def _dense(
        self, path: JointPath, is_free: Callable[[Array, Array], bool], carry: Carry | None, step: float = CHECK_STEP
    ) -> bool:
        """Whether `is_free` holds along a path, at configurations between which nothing moves further than `step` [m].

        Args:
            path: what is checked.
            is_free: judges configurations (N, 7) with their frames (N, 8, 4, 4).
            carry: what the hand holds, if anything.
        """
        s = np.linspace(0.0, path.length, int(np.clip(np.ceil(path.length / COARSE), 2, MOST_COARSE)) + 1)
        q = path.at(s)
        frames = self.checker.kinematics.frames(q)
        if not is_free(q, frames):
            return False
        while True:
            moved = self.moved(frames, carry)
            wide = np.flatnonzero(moved > step)
            if len(wide) == 0:
                return True
            parts = np.ceil(moved[wide] * SLACK / step).astype(np.int64)
            between = [np.linspace(s[k], s[k + 1], n + 1)[1:-1] for k, n in zip(wide, parts, strict=True)]
            new = np.concatenate(between)
            q = path.at(new)
            new_frames = self.checker.kinematics.frames(q)
            if not is_free(q, new_frames):
                return False
            s, frames = np.concatenate([s, new]), np.concatenate([frames, new_frames])
            order = np.argsort(s, kind="stable")
            s, frames = s[order], frames[order]

    def moved(self, frames: Array, carry: Carry | None = None) -> Array:
        """How far any point of arm and held object moves at most between neighbours of frames (N, ...). (N - 1,)."""
        moved = self.checker.body.moved(frames)
        if carry is None:
            return moved
        return np.maximum(moved, carry.moved(frames[:, 7] @ self.checker.kinematics.geometry.T_7_hand))

    def _carry_hits(self, frames: Array, carry: Carry) -> bool:
        """Whether the held object touches something at any of the frames (N, 8, 4, 4)."""
        hands = frames[:, 7] @ self.checker.kinematics.geometry.T_7_hand
        return bool(carry.hits(hands).any() or carry.hits_arm(frames, hands).any())

    def _free(self, q: Array, frames: Array, check: Check) -> bool:
        """Whether all configurations (N, 7) are inside the limits and free of collision."""
        if not self.checker.kinematics.possible(q).all():
            return False
        if check.carry is not None and self._carry_hits(frames, check.carry):
            return False
        if self.checker.hits_at(frames, check.scene, check.gripper, check.radius).any():
            return False
        return not self.checker.self_collision.any_collides(q)

    def connect(
        self, a: Array, b: Array, scene: Scene, search: bool = True, carry: Carry | None = None
    ) -> JointPath | None:
        """A free path from a to b (J,), or None.

        Args:
            a, b: shape (J,).
            scene: prepared scene.
            search: allows the tree search when nothing simpler works.
            carry: what the hand holds, if anything.
        """
        check = replace(self.check(scene, a), carry=carry)
        straight = line(a, b)
        if self.is_free(straight, check):
            return straight
        if not self.is_free(line(b, b), check):
            return None
        waypoints = self._waypoints(a, b, check, search)
        if waypoints is None:
            return None
        rounded = (blended(waypoints, intervals) for intervals in INTERVALS)
        free = [polyline(waypoints), *(path for path in rounded if self.is_free(path, check))]
        return min(free, key=self._duration)

    def _duration(self, path: JointPath) -> float:
        """Time along a path from rest to rest [s]; infinite when it cannot be timed."""
        try:
            return fastest(path, limits(self.checker.kinematics.robot)).duration
        except Refused:
            return float("inf")

    def _waypoints(self, a: Array, b: Array, check: Check, search_too: bool) -> Array | None:
        """Configurations (W, 7) from a to b whose straight connections are free."""
        for waypoints in self._detours(a, b):
            if self._edges_free(waypoints, check):
                return waypoints
        if not search_too:
            return None
        kinematics = self.checker.kinematics
        for step in (SEARCH_STEP, CHECK_STEP):

            def edge_free(p: Array, q: Array, step: float = step) -> bool:
                """For OMPL."""
                return self.is_free(line(p, q), check, step)

            found = search(a, b, kinematics.lower, kinematics.upper, edge_free)
            if found is None or self._edges_free(found, check):
                return found
        return None

    def _edges_free(self, waypoints: Array, check: Check) -> bool:
        """Whether the straight paths between waypoints (W, 7) are free."""
        return all(self.is_free(line(p, q), check) for p, q in pairwise(waypoints))

    def _detours(self, a: Array, b: Array) -> list[Array]:
        """Ways over raised hands and known configurations, the quickest first. Each (W, 7)."""
        kinematics = self.checker.kinematics
        ways = [[via] for via in self.via]
        for height in RAISES:
            up_a, up_b = self._raised(a, height), self._raised(b, height)
            ways += [[up] for up in (up_a, up_b) if up is not None]
            if up_a is not None and up_b is not None:
                ways.append([up_a, up_b])
        detours = [np.stack([a, *way, b]) for way in ways]
        return sorted(detours, key=lambda w: float((np.abs(np.diff(w, axis=0)) / kinematics.speed).max(axis=1).sum()))

    def _raised(self, q: Array, height: float) -> Array | None:
        """The configuration nearest to q whose hand is `height` [m] higher, with the same q7."""
        T = self.checker.kinematics.fk_hand(q)
        T[2, 3] += height
        found = self.checker.kinematics.search(T, q, q[6:7]).q
        return found[0] if len(found) else None
