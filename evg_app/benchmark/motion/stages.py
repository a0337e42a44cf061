"""Times of the planner's stages, measured from outside: CPU time, so that other processes do not count."""

import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from evg_app.benchmark.motion.targets import Targets
from evg_app.geometry import Array
from evg_app.motion.candidates import free_at_grasp
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.path import line
from evg_app.motion.scene import Scene, SceneView
from evg_app.motion.trajectory import time_path
from evg_app.types import Verdict

BEFORE_SCENE = (Verdict.IK, Verdict.JOINT_LIMIT, Verdict.SELF_COLLISION)
"""Verdicts of candidates that never reached the test of the arm against the scene."""


@dataclass(frozen=True)
class StageTimes:
    """CPU times [ms]; see `SceneRow`."""

    scene_ms: list[float] = field(default_factory=list)
    check_ms: list[float] = field(default_factory=list)
    legs_ms: list[float] = field(default_factory=list)
    path_ms: list[float] = field(default_factory=list)
    timing_ms: list[float] = field(default_factory=list)


def timed_stages(
    planner: MotionPlanner, targets: Targets, chosen: NDArray[np.int64], view: SceneView, q: Array
) -> StageTimes:
    """Prepare the scene, check each of the chosen targets and plan those that pass, one after the other."""
    times = StageTimes()
    for index in chosen:
        start = time.process_time()
        scene = planner.prepared(view, q)
        times.scene_ms.append(_since(start))
        T_base_grasp = planner.robot.T_base_task.matrix() @ targets.T_task_grasp[index]
        if _legs(times, planner, scene, T_base_grasp, q):
            start = time.process_time()
            decision = planner.plan_pick(targets.take(np.array([index])), view, q)
            if decision.pick is not None:
                rest = times.scene_ms[-1] + times.check_ms[-1] + times.legs_ms[-1]
                times.path_ms.append(max(_since(start) - rest, 0.0))
    return times


def _legs(times: StageTimes, planner: MotionPlanner, scene: Scene, T_base_grasp: Array, q: Array) -> bool:
    """Time check and legs of one target; whether it has legs."""
    start = time.process_time()
    candidates = free_at_grasp(planner.robot, planner.checker, scene, T_base_grasp, q)
    check = _since(start)
    if not (isinstance(candidates, Verdict) and candidates in BEFORE_SCENE):
        times.check_ms.append(check)
    if isinstance(candidates, Verdict):
        return False
    start = time.process_time()
    legs = planner.free_legs(scene, T_base_grasp, q)
    leg = None if isinstance(legs, Verdict) else next(legs, None)
    times.legs_ms.append(max(_since(start) - check, 0.0))
    if leg is None:
        return False
    for path in (line(q, leg.approach_q[0]), leg.approach, leg.lift):
        start = time.process_time()
        time_path(path, planner.robot)
        times.timing_ms.append(_since(start))
    return True


def _since(start: float) -> float:
    """[ms]."""
    return round((time.process_time() - start) * 1e3, 3)
