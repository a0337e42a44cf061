"""Run a benchmark: independent rounds on several processes, each written down as it ends."""

import multiprocessing
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import torch

from evg_app.benchmark.clutter.config import PROTOCOL, BenchmarkConfig
from evg_app.benchmark.clutter.rounds import RoundResult, run_round
from evg_app.benchmark.clutter.summary import by_seed, rates
from evg_app.benchmark.journal import Journal
from evg_app.errors import BadInput
from evg_app.grasping.protocol import Planner
from evg_app.trials.provenance import git_commit

Job = tuple[int, int]
"""Seed and number of a round."""

_at_work: list[tuple[BenchmarkConfig, Planner, str]] = []
"""What a worker process needs for every round; filled once when it starts."""


def benchmark(
    config: BenchmarkConfig,
    seeds: Sequence[int],
    rounds: int,
    workers: int = 1,
    json_path: Path | None = None,
    progress: Callable[[list[RoundResult], int], None] | None = None,
) -> dict[str, Any]:
    """Play `rounds` rounds of every seed and sum up; rounds already in the journal beside `json_path` are not repeated.

    Args:
        config: what to measure.
        seeds, rounds: which rounds.
        workers: processes.
        json_path: where the caller will write the answer; the journal is its neighbour `.rounds.jsonl`.
        progress: called after every round with the rounds so far and their number in all.

    Raises:
        EvgError: a bad name, folder or file.
    """
    if rounds < 1 or not seeds or len(set(seeds)) != len(seeds):
        raise BadInput(f"{rounds} rounds of seeds {list(seeds)}: ask for at least one round, and for each seed once")
    planner = config.planner()
    commit = git_commit()
    digest = config.digest(planner.weights_sha256)
    header = {"digest": digest, "config": config.to_dict(), "scenes": config.scenes_key()}
    jobs = [(seed, number) for seed in seeds for number in range(rounds)]
    with ExitStack() as stack:
        if json_path is None:
            json_path = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "result.json"
        journal = stack.enter_context(closing(Journal(journal_path(json_path), header, RoundResult)))
        done, wanted = {(row.seed, row.round) for row in journal.rows}, set(jobs)
        missing = [job for job in jobs if job not in done]
        for row in _played(config, planner, commit, missing, workers):
            journal.append(row)
            if progress is not None:
                progress([r for r in journal.rows if (r.seed, r.round) in wanted], len(jobs))
    chosen = {(row.seed, row.round): row for row in journal.rows}
    return _result(config, planner, list(seeds), [chosen[job] for job in jobs], header)


def journal_path(json_path: Path) -> Path:
    """Where the finished rounds of a result file are kept."""
    return json_path.with_suffix(".rounds.jsonl")


def _played(
    config: BenchmarkConfig, planner: Planner, commit: str, jobs: list[Job], workers: int
) -> Iterator[RoundResult]:
    """Rounds as they end; torch has one thread everywhere, so that answers and times do not depend on `workers`."""
    torch.set_num_threads(1)
    if workers <= 1 or len(jobs) <= 1:
        for seed, number in jobs:
            yield run_round(config, planner, seed, number, commit)
        return
    context = multiprocessing.get_context("spawn")
    with context.Pool(min(workers, len(jobs)), _start, (config, commit)) as pool:
        yield from pool.imap_unordered(_play, jobs)


def _start(config: BenchmarkConfig, commit: str) -> None:
    """Prepare a worker process; an interruption is the parent's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    torch.set_num_threads(1)
    _at_work[:] = [(config, config.planner(), commit)]


def _play(job: Job) -> RoundResult:
    """One round in a worker process."""
    config, planner, commit = _at_work[0]
    return run_round(config, planner, *job, commit)


def _result(
    config: BenchmarkConfig, planner: Planner, seeds: list[int], rows: list[RoundResult], header: dict[str, Any]
) -> dict[str, Any]:
    """The answer as JSON."""
    facts = rates(rows) | by_seed(rows)
    commits = sorted({row.git_commit for row in rows})
    return facts | {
        "model": planner.name,
        "weights_sha256": planner.weights_sha256,
        "seeds": seeds,
        "git_commit": ",".join(commits),
        "protocol": PROTOCOL,
        "config": header["config"],
        "scenes": header["scenes"],
        "rows": [row.to_dict() for row in rows],
    }
