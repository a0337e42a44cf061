"""Grasps that the planner finds of those that a complete search finds; a script, not a test.

PYTHONPATH=. .venv/bin/python tests/motion/reachable.py SCENES TARGETS [FIRST] writes JSON: reachability as the motion
benchmark counts it (labelled grasps among true meshes), TARGETS grasps in each of SCENES scenes of seed 22, from FIRST.
"""

import json
import sys

import numpy as np

from evg_app.benchmark.motion.cell import Cell
from evg_app.benchmark.motion.config import MotionBenchmark
from evg_app.benchmark.motion.targets import targets_of
from evg_app.motion.exhaustive import Reachability, reachability
from evg_app.motion.feasibility import MotionPlanner
from evg_app.trials.provenance import git_commit
from evg_app.trials.statistics import wilson

SEED = 22


def main(scenes: int, targets: int, first: int) -> None:
    """Search and print."""
    config = MotionBenchmark()
    planner = MotionPlanner(config.robot_config())
    T_base_task = planner.robot.T_base_task.matrix()
    found: list[Reachability] = []
    missed = []
    for number in range(first, first + scenes):
        with Cell(config, SEED, number) as cell:
            chosen = targets_of(cell.state(), config.candidates, np.random.default_rng([SEED, number, 1]))
            view, q = cell.true_view(), cell.q()
        scene = planner.prepared(view, q)
        for index in chosen.spread(targets):
            found.append(reachability(planner, scene, T_base_task @ chosen.T_task_grasp[index], q))
            if found[-1].legs and not found[-1].found_legs:
                missed.append([number, int(index)])
    facts = {}
    for name, total, mine in (
        ("configuration", [f.configuration for f in found], [f.found_configuration for f in found]),
        ("legs", [f.legs for f in found], [f.found_legs for f in found]),
    ):
        n, k = sum(total), sum(a and b for a, b in zip(total, mine, strict=True))
        facts[name] = {"found": k, "reachable": n, "ci": list(wilson(k, n))}
    out = {"git_commit": git_commit(), "seed": SEED, "first": first, "scenes": scenes, "targets": len(found)}
    sys.stdout.write(json.dumps(out | facts | {"missed": missed}, indent=1) + "\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 0)
