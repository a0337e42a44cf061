"""A network's own proposals, judged by physics: examples of what it believes, right or wrong."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import Array
from evg_app.grasping.planner import GraspPlanner, PlannerConfig
from evg_app.learning.labels import Kind, LabelledGrasps, WithContact
from evg_app.learning.physics import TrialBench
from evg_app.simulation.state import SceneState

SEARCH = PlannerConfig(threshold=0.05, nms_radius=0.008, nms_angle=0.26)
"""A wider search than a planner's: what it thinks poorly of is worth a look, too."""
VIEWS = 3
"""Views of a scene that are planned on."""
BEST_SHARE = 0.4
"""Share of the proposals that are the best ranked; the others are drawn from the rest."""


def propose(weights: str, grids: NDArray[np.float32], count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """About `count` poses (N, 4, 4) and openings [m] (N,) that a network proposes on some of the views (V, 40, 40, 40).

    Raises:
        WeightsError: the weights cannot be used.
    """
    poses, widths = [np.zeros((0, 4, 4))], [np.zeros(0)]
    each = -(-count // VIEWS)
    for view in rng.permutation(len(grids))[:VIEWS]:
        grasps = _planner(weights).plan(grids[view], int(rng.integers(2**31)))
        best = np.arange(min(len(grasps), round(BEST_SHARE * each)))
        rest = rng.permutation(np.arange(len(best), len(grasps)))[: each - len(best)]
        chosen = np.concatenate([best, rest])
        poses.append(grasps.T_task_grasp[chosen])
        widths.append(grasps.width[chosen])
    return np.concatenate(poses), np.concatenate(widths)


def try_all(state: SceneState, T_task_grasp: Array) -> tuple[LabelledGrasps, NDArray[np.uint8]]:
    """What physics says of poses (N, 4, 4): the labels, and `WithContact` of each (N,)."""
    bench = TrialBench(state)
    trials = [bench(T) for T in T_task_grasp]
    bench.close()
    kind = np.array([t.kind for t in trials], dtype=np.uint8)
    contact = np.array([WithContact.HOLDS if t.held else WithContact.FAILS for t in trials], dtype=np.uint8)
    width = np.array([t.width if t.kind == Kind.POSITIVE else 0.08 for t in trials])
    return LabelledGrasps(T_task_grasp, kind, width, np.full(len(kind), -1)), contact


@lru_cache(maxsize=1)
def _planner(weights: str) -> GraspPlanner:
    """The planner of a weights file, on one thread of this process."""
    import torch

    torch.set_num_threads(1)
    return GraspPlanner.load(weights=weights, config=SEARCH)
