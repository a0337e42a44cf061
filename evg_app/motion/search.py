"""Search for a way around obstacles: OMPL's RRT-Connect and path simplification, seeded and bounded by iterations.

Nothing depends on the clock, so equal inputs give equal paths.
"""

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from evg_app.errors import BadInput
from evg_app.geometry import Array

MAX_ITERATIONS = 200
"""Extensions of the trees that are tried before the search gives up."""
RANGE = 0.9
"""Longest edge of the trees [rad]."""

EdgeFree = Callable[[Array, Array], bool]


@cache
def _ompl() -> Any:
    """OMPL, silenced.

    Raises:
        BadInput: it is not installed.
    """
    try:
        from ompl import base, geometric, util
    except ImportError as error:
        raise BadInput(f"'ompl' cannot be imported ({error}). Run: .venv/bin/pip install -e .") from error
    util.noOutputHandler()
    return SimpleNamespace(base=base, geometric=geometric, util=util)


def _values(state: Any, count: int) -> Array:
    """An OMPL state as an array. Shape (J,)."""
    return np.array([state[k] for k in range(count)])


def search(start: Array, goal: Array, low: Array, high: Array, edge_free: EdgeFree, seed: int = 1) -> Array | None:
    """Waypoints (W, J) from `start` to `goal` whose straight edges are free, or None when none was found.

    Args:
        start, goal: shape (J,), both free.
        low, high: bounds of the samples [rad]. Shape (J,).
        edge_free: whether the straight line between two configurations (J,) is free.
        seed: of the samples, at least 1.
    """
    ompl = _ompl()
    ompl.util.RNG.setSeed(seed)
    information = _information(ompl, start, goal, low, high, edge_free)
    path = _solve(ompl, information, start, goal)
    if path is None:
        return None
    simplifier = ompl.geometric.PathSimplifier(information)
    simplifier.reduceVertices(path)
    simplifier.ropeShortcutPath(path)
    waypoints = np.stack([_values(state, len(start)) for state in path.getStates()])
    waypoints[0], waypoints[-1] = start, goal
    return waypoints


def _information(ompl: Any, start: Array, goal: Array, low: Array, high: Array, edge_free: EdgeFree) -> Any:
    """OMPL's space with our check of edges; the ends may lie outside the bounds of the samples."""
    space = _space(ompl, np.minimum(low, np.minimum(start, goal)), np.maximum(high, np.maximum(start, goal)))
    information = ompl.base.SpaceInformation(space)
    information.setStateValidityChecker(lambda state: True)
    information.setMotionValidator(_validator(ompl, information, edge_free, len(start)))
    information.setup()
    return information


def _solve(ompl: Any, information: Any, start: Array, goal: Array) -> Any:
    """OMPL's path, or None."""
    problem = ompl.base.ProblemDefinition(information)
    ends = [information.allocState() for _ in range(2)]
    for state, values in zip(ends, (start, goal), strict=True):
        for k, value in enumerate(values.tolist()):
            state[k] = value
    problem.setStartAndGoalStates(*ends, 1e-9)
    planner = ompl.geometric.RRTConnect(information)
    planner.setRange(RANGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    left = iter(range(MAX_ITERATIONS))
    planner.solve(ompl.base.PlannerTerminationCondition(lambda: next(left, None) is None))
    return problem.getSolutionPath() if problem.hasExactSolution() else None


def _space(ompl: Any, low: Array, high: Array) -> Any:
    """The space of joint positions between bounds (J,)."""
    space = ompl.base.RealVectorStateSpace(len(low))
    bounds = ompl.base.RealVectorBounds(len(low))
    for k, (a, b) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        bounds.setLow(k, a)
        bounds.setHigh(k, b)
    space.setBounds(bounds)
    return space


def _validator(ompl: Any, information: Any, edge_free: EdgeFree, count: int) -> Any:
    """OMPL's view of `edge_free`."""

    class Validator(ompl.base.MotionValidator):  # type: ignore[misc]
        """Asks `edge_free` about every edge."""

        def checkMotion(self, first: Any, second: Any) -> bool:
            """Called by OMPL."""
            return edge_free(_values(first, count), _values(second, count))

    return Validator(information)
