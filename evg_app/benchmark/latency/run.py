"""The whole table: every row with every number of threads, one after the other on the same machine."""

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evg_app.benchmark.latency.child import Job, encoded
from evg_app.benchmark.latency.subjects import model_of
from evg_app.errors import EvgError

PERCENTILES = {"median_ms": 50, "p95_ms": 95, "p99_ms": 99}
Progress = Callable[[dict[str, Any]], None]


class LatencyError(EvgError):
    """A row could not be measured."""


def table(
    names: Sequence[str],
    threads: Sequence[int],
    frames: int,
    weights: Mapping[str, str],
    device: str,
    progress: Progress,
) -> dict[str, Any]:
    """Time all rows.

    Args:
        names: of the rows, see `subjects.NAMES`.
        threads: numbers of threads to run each with.
        frames: how many depth images, which must be in the cache folder.
        weights: file or shipped name by model.
        device: where the networks run.
        progress: hears each row when it is done.

    Returns:
        The facts of the issue's `--json`.

    Raises:
        LatencyError: a row failed.
    """
    load_before = os.getloadavg()[0]
    measured = []
    for count in threads:
        for name in names:
            one = _measure(Job(name, count, frames, weights.get(model_of(name)), device, time.time()))
            measured.append((name, count, one))
            progress(row_of(name, count, one))
    gflops = {count: max(one["gflops"] for _, n, one in measured if n == count) for count in threads}
    rows = [with_floor(row_of(name, count, one), one, gflops[count]) for name, count, one in measured]
    whole = gflops[max(threads)]
    first = next((one for name, _, one in measured if name == "equiigd"), measured[0][2])
    return {
        "machine": {"processor": processor(), "cores": len(os.sched_getaffinity(0)), "load_before": load_before},
        "frames": frames,
        "device": device,
        "machine_gflops": whole,
        "machine_gflops_by_threads": {str(count): value for count, value in gflops.items()},
        "encoder_gflop": first["encoder_gflop"],
        "encoder_floor_ms": None if first["encoder_gflop"] is None else 1e3 * first["encoder_gflop"] / whole,
        "weights_sha256": first["weights_sha256"],
        "rows": rows,
    }


def row_of(name: str, threads: int, one: dict[str, Any]) -> dict[str, Any]:
    """A row of the table from what its process measured."""
    stages = {
        stage: {key: _percentile(values, q) for key, q in PERCENTILES.items()}
        for stage, values in one["stage_ms"].items()
    }
    return {
        "name": name,
        "threads": threads,
        **{key: _percentile(one["frame_ms"], q) for key, q in PERCENTILES.items()},
        "min_ms": round(min(one["frame_ms"]), 2),
        "cpu_median_ms": _percentile(one["frame_cpu_ms"], 50),
        "rss_mb": round(one["rss_mb"], 1),
        "first_grasp_s": round(one["first_grasp_s"], 2),
        "grasps_mean": round(one["grasps_mean"], 1),
        "random_weights": one["random_weights"],
        "weights_sha256": one["weights_sha256"],
        "stages": stages,
    }


def with_floor(row: dict[str, Any], one: dict[str, Any], gflops: float) -> dict[str, Any]:
    """The row with the least time its encoder could take on as many threads, and how often it takes that [ms]."""
    if one["encoder_gflop"] is None:
        return row
    floor = 1e3 * one["encoder_gflop"] / gflops
    return row | {"floor_ms": round(floor, 2), "over_floor": round(row["median_ms"] / floor, 2)}


def _measure(job: Job) -> dict[str, Any]:
    """A job in a process of its own."""
    env = os.environ | {"OMP_NUM_THREADS": str(job.threads), "OMP_WAIT_POLICY": "passive"}
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "row.json"
        command = [sys.executable, "-m", "evg_app.benchmark.latency.child", encoded(job), str(result)]
        done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
        if done.returncode != 0 or not result.is_file():
            last = "; ".join(done.stderr.strip().splitlines()[-3:])
            raise LatencyError(f"row {job.name} with {job.threads} threads failed: {last or done.returncode}")
        facts: dict[str, Any] = json.loads(result.read_text(encoding="utf-8"))
        return facts


def _percentile(values: Sequence[float], q: float) -> float:
    """Rounded to 10 us."""
    return round(float(np.percentile(values, q)), 2)


def processor() -> str:
    """The processor's name."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())
