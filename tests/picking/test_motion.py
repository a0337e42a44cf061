"""The adapter hands decisions through and turns "no way" into None."""

import numpy as np
from picking_fakes import Lab, line

from evg_app.errors import Refused
from evg_app.motion.plan import PickDecision, PickPlan
from evg_app.picking.motion import PlannedMotion
from evg_app.types import Verdict

LEGS = {"reach": 0.1, "approach": 0.2, "lift": 0.3, "transport": 0.4, "retreat": 0.5, "back": 0.6}
"""A goal for each motion, to tell them apart [rad]."""


class _Planner:
    """Stands in for `MotionPlanner`."""

    def __init__(self, decision=None) -> None:
        self.decision, self.asked = decision, []

    def plan_pick(self, grasps, scene, q_start, *, accept=1, max_examined=60):
        self.asked.append((scene, max_examined))
        return self.decision

    def go_to(self, q_start, q_goal, scene=None):
        self.asked.append(scene)
        if q_goal[0] > 1.0:
            raise Refused("no path")
        return line(q_start, q_goal)


def _view():
    lab = Lab()
    return lab.perception.view(None, None)


def test_every_motion_keeps_its_name():
    plan = PickPlan(np.eye(4), **{name: line(0.0, goal) for name, goal in LEGS.items()})
    planner = _Planner(PickDecision((Verdict.IK, Verdict.ACCEPTED), plan, 1, True))
    decision = PlannedMotion(planner, max_examined=7).decide(None, np.eye(4), _view(), np.zeros(7))
    assert (decision.grasp_index, decision.flipped, planner.asked[0][1]) == (1, True, 7)
    assert {name: path.q[-1, 0] for name, path in decision.pick.trajectories().items()} == LEGS


def test_nothing_feasible_has_no_index():
    planner = _Planner(PickDecision((Verdict.IK,), None))
    decision = PlannedMotion(planner).decide(None, np.eye(4), _view(), np.zeros(7))
    assert decision.pick is None and decision.grasp_index is None and decision.verdicts == (Verdict.IK,)


def test_a_refused_way_is_none_and_no_view_means_no_scene():
    planner = _Planner()
    motion = PlannedMotion(planner)
    assert motion.route(np.zeros(7), np.full(7, 2.0), _view()) is None
    assert motion.route(np.zeros(7), np.full(7, 0.5), None).q[-1, 0] == 0.5
    assert planner.asked[0] is not None and planner.asked[1] is None
