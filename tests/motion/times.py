"""How long the planner's stages take, on a machine that does nothing else; a script, not a test.

PYTHONPATH=. .venv/bin/python tests/motion/times.py SCENES TARGETS writes JSON: CPU times [ms] of one thread over
TARGETS grasps in each of SCENES observed scenes (seed 21), as the motion benchmark takes them.
"""

import json
import sys

import numpy as np

from evg_app.benchmark.motion.cell import Cell
from evg_app.benchmark.motion.config import MotionBenchmark
from evg_app.benchmark.motion.row import TIMES
from evg_app.benchmark.motion.stages import timed_stages
from evg_app.benchmark.motion.targets import targets_of
from evg_app.motion.feasibility import MotionPlanner
from evg_app.trials.provenance import git_commit

SEED = 21
SHARES = (5, 50, 95, 99)


def main(scenes: int, targets: int) -> None:
    """Time and print."""
    config = MotionBenchmark()
    planner = MotionPlanner(config.robot_config())
    found: dict[str, list[float]] = {name: [] for name in TIMES}
    for number in range(scenes):
        with Cell(config, SEED, number) as cell:
            chosen = targets_of(cell.state(), config.candidates, np.random.default_rng([SEED, number, 1]))
            view, q = cell.observe(planner.kinematics).view, cell.q()
        times = timed_stages(planner, chosen, chosen.spread(targets), view, q)
        for name in TIMES:
            found[name] += getattr(times, name)
    facts = {name: {f"p{p}": round(float(np.percentile(ms, p)), 3) for p in SHARES} for name, ms in found.items()}
    counts = {name: {"n": len(ms), "max": max(ms)} for name, ms in found.items()}
    out = {name: counts[name] | facts[name] for name in TIMES}
    sys.stdout.write(json.dumps({"git_commit": git_commit(), "scenes": scenes, "times_ms": out}, indent=1) + "\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
