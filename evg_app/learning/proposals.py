"""A network's own proposals with their truth: examples of what it believes, right or wrong."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import Array
from evg_app.grasping.planner import GraspPlanner, PlannerConfig
from evg_app.learning.labels import Kind, LabelledGrasps, WithContact, judge, with_contact
from evg_app.learning.physics import TrialBench
from evg_app.learning.solids import SceneSolids
from evg_app.simulation.state import SceneState

SEARCH = PlannerConfig(
    blocks=192, points=256, per_block=2, sampled=256, threshold=0.05, nms_radius=0.008, nms_angle=0.26
)
"""A wider search than a planner's: what it thinks poorly of is worth a look, too."""
VIEWS = 3
"""Views of a scene that are planned on."""
BEST_SHARE = 0.4
"""Share of the proposals that are the best ranked; the others are drawn from the rest."""


def propose(weights: str, grids: NDArray[np.float32], count: int, rng: np.random.Generator) -> Array:
    """At most about `count` poses (N, 4, 4) that a network proposes on some of the views (V, 40, 40, 40).

    First the best of every view, then the second best ones, and so on; the last ones were drawn from the rest. It is
    chance whether a view's are ranked by strict success or by that with a touch allowed on the approach.

    Raises:
        WeightsError: the weights cannot be used.
    """
    poses, places = [np.zeros((0, 4, 4))], [np.zeros(0, dtype=np.intp)]
    each = -(-count // VIEWS)
    for view in rng.permutation(len(grids))[:VIEWS]:
        planner = _planner(weights, bool(rng.random() < 0.5))
        grasps = planner.plan(grids[view], int(rng.integers(2**31)))
        best = np.arange(min(len(grasps), round(BEST_SHARE * each)))
        rest = rng.permutation(np.arange(len(best), len(grasps)))[: each - len(best)]
        poses.append(grasps.T_task_grasp[np.concatenate([best, rest])])
        places.append(np.arange(len(poses[-1])))
    return np.concatenate(poses)[np.argsort(np.concatenate(places), kind="stable")]


def judge_proposals(
    scene: SceneSolids, state: SceneState, T_task_grasp: Array, tries: int
) -> tuple[LabelledGrasps, NDArray[np.uint8]]:
    """Labels of poses (N, 4, 4), and `WithContact` of each.

    The first `tries` go to physics: where the rule is wrong about what the network likes best, it must not learn from
    the rule. The rule judges the others; those too close to call for it are left out.
    """
    tried, contact = try_all(state, T_task_grasp[:tries])
    judged, sure = judge(scene, T_task_grasp[tries:])
    by_rule = judged.take(sure)
    return tried.join(by_rule), np.concatenate([contact, with_contact(scene, by_rule)])


def try_all(state: SceneState, T_task_grasp: Array) -> tuple[LabelledGrasps, NDArray[np.uint8]]:
    """What physics says of poses (N, 4, 4): the labels, and `WithContact` of each (N,)."""
    bench = TrialBench(state)
    trials = [bench(T) for T in T_task_grasp]
    bench.close()
    kind = np.array([t.kind for t in trials], dtype=np.uint8)
    contact = np.array([WithContact.HOLDS if t.held else WithContact.FAILS for t in trials], dtype=np.uint8)
    width = np.array([t.width if t.kind == Kind.POSITIVE else 0.08 for t in trials])
    return LabelledGrasps(T_task_grasp, kind, width, np.full(len(kind), -1)), contact


@lru_cache(maxsize=2)
def _planner(weights: str, allow_contact: bool) -> GraspPlanner:
    """The planner of a weights file, on one thread of this process."""
    import torch

    torch.set_num_threads(1)
    return GraspPlanner.load(weights=weights, config=replace(SEARCH, allow_contact=allow_contact))
