"""One row in a process of its own, so that its memory, threads and start are its own. Run by `run`, not by hand.

Usage: python -m evg_app.benchmark.latency.child JOB_JSON RESULT_FILE
"""

import json
import resource
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Job:
    """What to time.

    Attributes:
        name: of the row.
        threads: of the planner.
        frames: how many.
        weights: see `subjects.subject`.
        device: where the network runs.
        started: when the process was asked for [s since the epoch].
    """

    name: str
    threads: int
    frames: int
    weights: str | None
    device: str
    started: float


@dataclass
class Laps:
    """Times of the stages of one frame [ms]."""

    last: float = field(default_factory=time.perf_counter)
    stages: dict[str, float] = field(default_factory=dict)

    def __call__(self, stage: str) -> None:
        """A stage is over."""
        now = time.perf_counter()
        self.stages[stage] = self.stages.get(stage, 0.0) + 1e3 * (now - self.last)
        self.last = now


def measure(job: Job) -> dict[str, Any]:
    """Run the frames of a job. Times [ms] of each frame and stage, memory [MB], what the machine can do."""
    import torch

    from evg_app.benchmark.latency.floor import encoder_gflop, machine_gflops
    from evg_app.benchmark.latency.frames import load_frame, load_frames
    from evg_app.benchmark.latency.subjects import subject
    from evg_app.grasping.planner import GraspPlanner

    torch.set_num_threads(job.threads)
    under_test = subject(job.name, job.weights, job.device)
    under_test.run(load_frame(0), Laps())
    first_grasp = time.time() - job.started
    memory = [_peak_mb()]
    gflops = [machine_gflops()]
    rows: list[tuple[float, float, dict[str, float], int]] = []
    for frame in load_frames(job.frames):
        laps, cpu = Laps(), time.process_time()
        start = laps.last
        grasps = under_test.run(frame, laps)
        rows.append((1e3 * (laps.last - start), 1e3 * (time.process_time() - cpu), laps.stages, len(grasps)))
    memory.append(_peak_mb())
    gflops.append(machine_gflops())
    planner = under_test.planner
    return {
        "frame_ms": [round(row[0], 3) for row in rows],
        "frame_cpu_ms": [round(row[1], 3) for row in rows],
        "stage_ms": {name: [round(row[2].get(name, 0.0), 3) for row in rows] for name in _stages(rows)},
        "grasps_mean": float(np.mean([row[3] for row in rows])),
        "first_grasp_s": first_grasp,
        "rss_mb": memory[-1],
        "gflops": max(gflops),
        "encoder_gflop": encoder_gflop(planner.backbone.cpu()) if isinstance(planner, GraspPlanner) else None,
        "weights_sha256": planner.weights_sha256,
        "random_weights": under_test.random_weights,
    }


def _stages(rows: list[tuple[float, float, dict[str, float], int]]) -> list[str]:
    """Names of all stages, in the order of the frame that has most of them."""
    longest: dict[str, float] = {}
    for _, _, stages, _ in rows:
        longest = stages if len(stages) > len(longest) else longest
    return list(longest)


def _peak_mb() -> float:
    """The most memory this process has had [MB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak / 1e3 * 1.024


def encoded(job: Job) -> str:
    """The job as the child's argument."""
    return json.dumps(asdict(job))


if __name__ == "__main__":
    Path(sys.argv[2]).write_text(json.dumps(measure(Job(**json.loads(sys.argv[1])))), encoding="utf-8")
