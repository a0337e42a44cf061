"""Times of the planner's stages, measured from outside: CPU time, so that other processes do not count."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evg_app.benchmark.motion.targets import Targets
from evg_app.geometry import Array
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.scene import SceneView
from evg_app.types import Verdict

BEFORE_SCENE = (Verdict.IK, Verdict.JOINT_LIMIT, Verdict.SELF_COLLISION)
"""Verdicts of candidates that never reached the test of the arm against the scene."""


@dataclass(frozen=True)
class StageTimes:
    """CPU times [ms]; see `SceneRow`."""

    scene_ms: tuple[float, ...]
    check_ms: tuple[float, ...]
    path_ms: tuple[float, ...]


def timed_stages(
    planner: MotionPlanner, targets: Targets, chosen: NDArray[np.int64], view: SceneView, q: Array
) -> StageTimes:
    """Prepare the scene, check each of the chosen targets and plan those that pass, one after the other."""
    scene_ms, check_ms, path_ms = [], [], []
    T_base_task = planner.robot.T_base_task.matrix()
    for index in chosen:
        start = time.process_time()
        scene = planner.prepared(view, q)
        prepared = time.process_time()
        legs = planner.free_legs(scene, T_base_task @ targets.T_task_grasp[index], q)
        free = not isinstance(legs, Verdict) and next(legs, None) is not None
        checked = time.process_time()
        scene_ms.append(_ms(start, prepared))
        if not (isinstance(legs, Verdict) and legs in BEFORE_SCENE):
            check_ms.append(_ms(prepared, checked))
        if free:
            begin = time.process_time()
            decision = planner.plan_pick(targets.take(np.array([index])), view, q)
            if decision.pick is not None:
                path_ms.append(max(_ms(begin, time.process_time()) - scene_ms[-1] - check_ms[-1], 0.0))
    return StageTimes(tuple(scene_ms), tuple(check_ms), tuple(path_ms))


def _ms(start: float, end: float) -> float:
    return round((end - start) * 1e3, 3)
