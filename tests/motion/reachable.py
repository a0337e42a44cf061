"""Grasps that the planner finds of those that a complete search finds; a script, not a test.

PYTHONPATH=. .venv/bin/python tests/motion/reachable.py SCENES TARGETS [FIRST] writes a line of JSON for each of SCENES
scenes of seed 22, from FIRST: reachability as the motion benchmark counts it, of TARGETS labelled grasps a scene.
"""

import json
import sys

import numpy as np

from evg_app.benchmark.motion.cell import Cell
from evg_app.benchmark.motion.config import MotionBenchmark
from evg_app.benchmark.motion.targets import targets_of
from evg_app.motion.exhaustive import reachability
from evg_app.motion.feasibility import MotionPlanner
from evg_app.trials.provenance import git_commit

SEED = 22


def main(scenes: int, targets: int, first: int) -> None:
    """Search and print."""
    config = MotionBenchmark()
    planner = MotionPlanner(config.robot_config())
    T_base_task = planner.robot.T_base_task.matrix()
    commit = git_commit()
    for number in range(first, first + scenes):
        with Cell(config, SEED, number) as cell:
            chosen = targets_of(cell.state(), config.candidates, np.random.default_rng([SEED, number, 1]))
            view, q = cell.true_view(), cell.q()
        scene, picked = planner.prepared(view, q), chosen.spread(targets)
        found = [reachability(planner, scene, T_base_task @ chosen.T_task_grasp[k], q) for k in picked]
        facts = {
            "git_commit": commit,
            "scene": number,
            "targets": len(found),
            "configuration": sum(f.configuration for f in found),
            "found_configuration": sum(f.found_configuration for f in found),
            "legs": sum(f.legs for f in found),
            "found_legs": sum(f.found_legs for f in found),
        }
        sys.stdout.write(json.dumps(facts) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 0)
