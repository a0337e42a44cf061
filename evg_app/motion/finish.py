"""From a straight approach and lift to a whole pick: joined by free paths, the object in the hand, and timed."""

from collections.abc import Iterator
from itertools import chain, islice

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.errors import LimitViolation, Refused
from evg_app.geometry import Array
from evg_app.motion.carry import Carry, drop_goals
from evg_app.motion.held import Held, estimates
from evg_app.motion.kinematics import hand_of_grasp
from evg_app.motion.legs import Leg
from evg_app.motion.path import JointPath
from evg_app.motion.plan import PickPlan
from evg_app.motion.route import Router
from evg_app.motion.scene import Scene
from evg_app.motion.trajectory import time_path
from evg_app.motion.verify import verify_joined
from evg_app.types import Verdict

MAX_LEGS = 4
"""Executions of one grasp for which free paths are looked for."""
DETOUR = 1.3
"""Another execution is tried when a plan takes longer than this times what the straight way would: one, as each costs a
tenth to a half of a second."""


class EmptyHanded:
    """Free paths of one decision on which nothing is in the hand, each looked for once."""

    def __init__(self, router: Router, scene: Scene) -> None:
        self._router, self.scene = router, scene
        self._known: dict[tuple[bytes, bytes], JointPath | None] = {}
        self._searched: set[tuple[bytes, bytes]] = set()

    def connect(self, a: Array, b: Array, search: bool) -> JointPath | None:
        """From a to b (7,), or None; `search` allows the tree search when nothing simpler works."""
        key = a.tobytes(), b.tobytes()
        if key not in self._known:
            self._known[key] = self._router.connect(a, b, self.scene, False)
        if self._known[key] is None and search and key not in self._searched:
            self._searched.add(key)
            self._known[key] = self._router.connect(a, b, self.scene, True)
        return self._known[key]


class Finisher:
    """Completes picks. Pure: equal inputs give equal plans."""

    def __init__(self, robot: RobotConfig, router: Router, tip: float) -> None:
        """`tip` is where the finger tips end on the grasp's z axis [m]."""
        self._robot, self._router, self._tip = robot, router, tip
        self._look_q = np.array(robot.look_q_rad)

    def plan(
        self, legs: Iterator[Leg], scene: Scene, T_base_grasp: Array, width: float, q_start: Array, search: bool
    ) -> tuple[Leg, PickPlan] | Verdict:
        """The legs completed, with the whole object in hand or else less of it: the first that needs no long detour.

        Args:
            legs: free executions of one grasp, cheapest first.
            scene: prepared scene.
            T_base_grasp: shape (4, 4).
            width: opening at the grasp [m].
            q_start: where the arm is. Shape (7,).
            search: whether tree searches may be made when nothing simpler works.
        """
        first = next(legs, None)
        if first is None:
            return Verdict.ARM_COLLISION
        sizes = estimates(self._robot, scene, T_base_grasp, width, self._tip)
        whole, routes = next(sizes), EmptyHanded(self._router, scene)
        seen: list[Leg] = []
        best: tuple[Leg, PickPlan] | None = None
        for leg in islice(chain([first], legs), MAX_LEGS):
            seen.append(leg)
            plan = self._complete(leg, whole, routes, q_start, False)
            second = best is not None
            if plan is not None and (best is None or plan.cycle < best[1].cycle):
                best = (leg, plan)
            if best is not None and (second or best[1].cycle < DETOUR * leg.cost):
                return best
        if best is not None:
            return best
        for leg, held, with_search in _last_resorts(seen, whole, sizes, search):
            plan = self._complete(leg, held, routes, q_start, with_search)
            if plan is not None:
                return leg, plan
        return Verdict.NO_PATH

    def _complete(self, leg: Leg, held: Held, routes: EmptyHanded, q_start: Array, search: bool) -> PickPlan | None:
        """Join paths to a leg and time everything; None when something is missing."""
        router = self._router
        reach = routes.connect(q_start, leg.approach_q[0], search)
        if reach is None:
            return None
        T_base_hand = hand_of_grasp(self._robot, leg.T_base_grasp)
        held = held.attached(T_base_hand)
        if router.carry_hits(leg.lift, self._beside_arm(Carry.lift(held, T_base_hand), leg.lift_q[0])):
            return None
        transport = self._transport(leg.lift.end, held, routes.scene, search)
        if transport is None:
            return None
        retreat = routes.connect(leg.lift.end, self._look_q, search)
        if retreat is None:
            return None
        back = routes.connect(transport.end, self._look_q, search)
        if back is None:
            return None
        return self._timed(leg, transport, reach, retreat, back)

    def _transport(self, lifted_q: Array, held: Held, scene: Scene, search: bool) -> JointPath | None:
        """To the first drop pose that can be reached with the object."""
        kinematics = self._router.checker.kinematics
        tip = self._tip + self._robot.gripper.hand_to_grasp_z_m
        T_lifted = kinematics.fk_hand(lifted_q)
        for goal in drop_goals(self._robot, kinematics, held, lifted_q, tip):
            carry = self._beside_arm(Carry.transport(held, T_lifted, kinematics.fk_hand(goal)), lifted_q)
            path = self._router.connect(lifted_q, goal, scene, search, carry)
            if path is not None:
                return path
        return None

    def _beside_arm(self, carry: Carry, q: Array) -> Carry:
        """With the arm's own links, where the carry begins at q (7,)."""
        checker = self._router.checker
        frames = checker.kinematics.frames(q[None])[0]
        return carry.beside(checker.links, frames, frames[7] @ checker.kinematics.geometry.T_7_hand)

    def _timed(
        self, leg: Leg, transport: JointPath, reach: JointPath, retreat: JointPath, back: JointPath
    ) -> PickPlan | None:
        """All paths timed and verified, alone and joined; None when one cannot be."""
        robot, carrying = self._robot, self._robot.limits.carry_scale
        try:
            plan = PickPlan(
                T_base_grasp=leg.T_base_grasp,
                reach=time_path(reach, robot),
                approach=time_path(leg.approach, robot),
                lift=time_path(leg.lift, robot, carrying),
                transport=time_path(transport, robot, carrying),
                retreat=time_path(retreat, robot),
                back=time_path(back, robot),
            )
            verify_joined((plan.reach, plan.approach, plan.lift, plan.transport, plan.back), robot)
            verify_joined((plan.lift, plan.retreat), robot)
        except (Refused, LimitViolation):
            return None
        return plan


def _last_resorts(
    legs: list[Leg], whole: Held, smaller: Iterator[Held], search: bool
) -> Iterator[tuple[Leg, Held, bool]]:
    """What is tried when no leg can be completed with the whole object: legs, estimates, whether to search."""
    before = [whole]
    for held in smaller:
        yield from ((leg, held, False) for leg in legs)
        if search:
            yield from ((legs[0], larger, True) for larger in (*before, held))
        before = []
