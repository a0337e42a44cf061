"""Run the motion benchmark: independent scenes on several processes, each written down as it ends."""

import multiprocessing
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import torch

from evg_app.benchmark.journal import Journal
from evg_app.benchmark.motion.config import PROTOCOL, MotionBenchmark
from evg_app.benchmark.motion.row import SceneRow
from evg_app.benchmark.motion.scene import POLICIES, Planners, run_scene
from evg_app.benchmark.motion.summary import summary
from evg_app.errors import BadInput
from evg_app.trials.provenance import git_commit

_at_work: list[tuple[MotionBenchmark, Planners, str]] = []
"""What a worker process needs for every scene; filled once when it starts."""


def benchmark(
    config: MotionBenchmark,
    seed: int,
    scenes: int,
    jobs: int = 1,
    json_path: Path | None = None,
    progress: Callable[[list[SceneRow], int], None] | None = None,
) -> dict[str, Any]:
    """Run `scenes` scenes of a seed and sum up; scenes in the journal beside `json_path` are not repeated.

    Args:
        config: what to measure.
        seed, scenes: which scenes: numbers 0 to scenes - 1.
        jobs: processes.
        json_path: where the caller will write the answer; the journal is its neighbour `.scenes.jsonl`.
        progress: called after every scene with the scenes so far and their number in all.

    Raises:
        EvgError: a bad name, folder or file.
    """
    if scenes < 1 or seed < 0:
        raise BadInput(f"{scenes} scenes of seed {seed}: ask for at least one scene, and a seed from 0 up")
    header = {"digest": f"{config.digest()}-{seed}", "config": config.to_dict(), "seed": seed, "protocol": PROTOCOL}
    with ExitStack() as stack:
        if json_path is None:
            json_path = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "result.json"
        journal = stack.enter_context(closing(Journal(journal_path(json_path), header, SceneRow)))
        done = {row.number for row in journal.rows}
        missing = [number for number in range(scenes) if number not in done]
        for row in _run(config, seed, missing, jobs):
            journal.append(row)
            if progress is not None:
                progress([r for r in journal.rows if r.number < scenes], scenes)
    rows = sorted((row for row in journal.rows if row.number < scenes), key=lambda row: row.number)
    policy, changed_area = config.robot_config().unknown_space, config.camera_config().recheck.area_m2
    facts = summary(rows, policy, POLICIES, changed_area)
    commits = sorted({row.git_commit for row in rows})
    origin = {"seed": seed, "git_commit": ",".join(commits), "protocol": PROTOCOL, "config": config.to_dict()}
    return facts | origin | {"rows": [row.to_dict() for row in rows]}


def journal_path(json_path: Path) -> Path:
    """Where the finished scenes of a result file are kept."""
    return json_path.with_suffix(".scenes.jsonl")


def _run(config: MotionBenchmark, seed: int, numbers: list[int], jobs: int) -> Iterator[SceneRow]:
    """Scenes as they end."""
    commit = git_commit()
    if jobs <= 1 or len(numbers) <= 1:
        planners = Planners(config) if numbers else None
        for number in numbers:
            assert planners is not None
            yield run_scene(config, planners, seed, number, commit)
        return
    context = multiprocessing.get_context("spawn")
    with context.Pool(min(jobs, len(numbers)), _start, (config, commit)) as pool:
        yield from pool.imap_unordered(_one, [(seed, number) for number in numbers])


def _start(config: MotionBenchmark, commit: str) -> None:
    """Prepare a worker process; an interruption is the parent's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    torch.set_num_threads(1)
    _at_work[:] = [(config, Planners(config), commit)]


def _one(job: tuple[int, int]) -> SceneRow:
    """One scene in a worker process."""
    config, planners, commit = _at_work[0]
    return run_scene(config, planners, *job, commit)
