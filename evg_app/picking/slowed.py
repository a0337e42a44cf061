"""A `Motion` whose trajectories are driven at a share of their speed."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from evg_app.geometry import Array
from evg_app.picking.context import Decision, Motion, View
from evg_app.types import Grasps, Trajectory


class SlowedMotion:
    """Implements `picking.context.Motion`: decides and plans as `motion` does, and slows what comes out."""

    def __init__(self, motion: Motion, slow: Callable[[Trajectory], Trajectory]) -> None:
        self._motion, self._slow = motion, slow

    def decide(self, grasps: Grasps, T_base_task: Array, view: View, q_start: Array) -> Decision:
        """Judge candidates, best first, until one can be executed. `q_start` [rad], shape (J,)."""
        decision = self._motion.decide(grasps, T_base_task, view, q_start)
        if decision.pick is None:
            return decision
        slower: dict[str, Any] = {name: self._slow(path) for name, path in decision.pick.trajectories().items()}
        return replace(decision, pick=replace(decision.pick, **slower))

    def route(self, q_start: Array, q_goal: Array, view: View | None) -> Trajectory | None:
        """A collision-free path [rad]; None when there is none."""
        way = self._motion.route(q_start, q_goal, view)
        return None if way is None else self._slow(way)
