"""The whole study: sessions that are missing are played, and everything is summed up."""

import multiprocessing
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

from evg_app.benchmark.calibration.summary import summary
from evg_app.benchmark.calibration.units import BAD, Kind, SessionRow, Study, collected, judge, solved
from evg_app.benchmark.journal import Journal
from evg_app.config.calibration import MODES, Mode
from evg_app.trials.provenance import canonical, provenance, sha256

VERSION = 3
"""Raised when sessions are drawn differently, so that old lines are not continued."""

Unit = tuple[Kind, Mode, int]


def units(good: int, bad: int, first: int) -> list[Unit]:
    """Sessions in the order they are played: `good` and `bad` (of each kind) in each mode, from seed `first` on."""
    found: list[Unit] = []
    for seed in range(first, first + max(good, bad)):
        for mode in MODES:
            if seed < first + good:
                found.append(("good", mode, seed))
            if seed < first + bad:
                found += [(kind, mode, seed) for kind in BAD]
    return found


def play(
    study: Study, wanted: list[Unit], workers: int, path: Path, progress: Callable[[SessionRow, int, int], None]
) -> dict[str, Any]:
    """Play what is missing in the journal beside `path` (`.sessions.jsonl`), and sum up.

    Collectors, the one solver and the judge are different processes; only collectors and judge know the truth.

    Raises:
        BadInput: the journal belongs to another study, or cannot be written.
    """
    settings = {"study": asdict(study), "version": VERSION}
    header = {"digest": sha256(canonical(settings)), "settings": settings}
    with closing(Journal(path.with_suffix(".sessions.jsonl"), header, SessionRow)) as journal:
        done = {(row.kind, row.mode, row.seed) for row in journal.rows}
        missing = [unit for unit in wanted if unit not in done]
        if missing:
            spawn = multiprocessing.get_context("spawn")
            with ProcessPoolExecutor(workers, spawn) as collectors, ProcessPoolExecutor(1, spawn) as solver:
                for unit, session in zip(missing, _collect(collectors, study, missing), strict=True):
                    row = judge(study, *unit, solver.submit(solved, session).result())
                    journal.append(row)
                    progress(row, len(journal.rows), len(wanted))
    rows = [row for row in journal.rows if (row.kind, row.mode, row.seed) in set(wanted)]
    return {**settings, **summary(rows), "provenance": provenance()}


def _collect(pool: ProcessPoolExecutor, study: Study, missing: list[Unit]) -> Iterable[Any]:
    """Sessions of the missing units, in their order, as the collectors finish them."""
    kinds, modes, seeds = zip(*missing, strict=True)
    return pool.map(collected, [study] * len(missing), kinds, modes, seeds)
