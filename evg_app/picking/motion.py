"""`evg_app.motion` behind the loop's `Motion` protocol."""

from evg_app.errors import BadInput, Refused
from evg_app.geometry import Array
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.plan import PickPlan
from evg_app.motion.scene import SceneView
from evg_app.picking.context import Decision, ReadyPick, View
from evg_app.types import Box, Grasps, Trajectory


class PlannedMotion:
    """Implements `picking.context.Motion`.

    Args:
        planner: judges and plans; it knows the robot config, so where the workspace is.
        boxes: declared obstacles beside those of the robot config, base frame.
        max_examined: candidates that are looked at in one decision.
    """

    def __init__(self, planner: MotionPlanner, boxes: tuple[Box, ...] = (), max_examined: int = 60) -> None:
        self._planner, self._boxes, self._max_examined = planner, boxes, max_examined

    def decide(self, grasps: Grasps, T_base_task: Array, view: View, q_start: Array) -> Decision:
        """Judge candidates, best first, until one can be executed. `T_base_task` is the robot config's."""
        decision = self._planner.plan_pick(grasps, self._scene(view), q_start, max_examined=self._max_examined)
        if decision.pick is None:
            return Decision(decision.verdicts, None, None, False)
        return Decision(decision.verdicts, _ready(decision.pick), decision.grasp_index, decision.flipped)

    def route(self, q_start: Array, q_goal: Array, view: View | None) -> Trajectory | None:
        """A collision-free path [rad], around the view when given; None when there is none."""
        try:
            return self._planner.go_to(q_start, q_goal, None if view is None else self._scene(view))
        except (Refused, BadInput):
            return None

    def _scene(self, view: View) -> SceneView:
        """What motion is judged against."""
        return SceneView(view.tsdf, view.volume, self._boxes)


def _ready(plan: PickPlan) -> ReadyPick:
    """The plan's motions, in the loop's words."""
    return ReadyPick(
        T_base_grasp=plan.T_base_grasp,
        reach=plan.reach,
        approach=plan.approach,
        lift=plan.lift,
        transport=plan.transport,
        back=plan.back,
        retreat=plan.retreat,
    )
