"""A log of many attempts, written by the store itself except for the arrays: what a season in the lab leaves.

`python tests/trials/big_log.py --attempts 10000` times statistics and report on one.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from unittest.mock import patch

import numpy as np

from evg_app.events import (
    AttemptFinished,
    AttemptOutcome,
    AttemptStarted,
    Evidence,
    GraspsPlanned,
    Judged,
    RoundFinished,
    RoundStarted,
    RunFinished,
    RunStarted,
    Stage,
    StageTimed,
    StateEntered,
    StopReason,
)
from evg_app.geometry import translation
from evg_app.trials import arrays
from evg_app.trials.folder import make
from evg_app.trials.page import page
from evg_app.trials.rows import read_rows
from evg_app.trials.store import TrialStore
from evg_app.trials.summary import summary
from evg_app.types import Grasps, Verdict

STATES = ("look", "observe", "plan", "filter", "reach", "approach", "close", "lift", "verify", "drop", "release")
STAGES = (Stage.CAPTURE, Stage.FILTER, Stage.FUSE, Stage.PLAN, Stage.JUDGE, Stage.ROUTE)


def big_log(folder: Path, attempts: int, seed: int = 0) -> Path:
    """A run of `attempts` attempts in rounds of five."""
    rng = np.random.default_rng(seed)
    T = np.tile(translation(0.15, 0.15, 0.1), (4, 1, 1))
    verdicts = (Verdict.IK, Verdict.GRIPPER_COLLISION, Verdict.ACCEPTED, Verdict.NOT_EXAMINED)
    with patch.object(arrays, "write", lambda path, gathered: "0" * 64):
        store = TrialStore(make(folder), {"robot": {"name": "fake"}}, {"git_commit": "c0ffee"})
        store._db.execute("PRAGMA synchronous = OFF")
        store(RunStarted((0,), attempts // 5, "fake", "0" * 64))
        for i in range(attempts):
            if i % 5 == 0:
                store(RoundStarted(0, i // 5, 5))
            name = f"s0-r{i // 5:05d}-a{i % 5:02d}"
            store(AttemptStarted(name, 0, i // 5, i % 5, i))
            for state in STATES:
                store(StateEntered(state))
            for stage in STAGES:
                store(StageTimed(stage, float(rng.gamma(2.0, 50.0))))
            score = np.array([0.9, 0.8, rng.uniform(0.3, 0.8), 0.1])
            store(GraspsPlanned(Grasps(T, np.full(4, 0.05), score)))
            store(Judged(verdicts, 2, False, T[0]))
            good = bool(rng.random() < 0.85)
            outcome = AttemptOutcome.SUCCESS if good else AttemptOutcome.FAILURE
            failure = "" if good else str(rng.choice(["nothing held after lift", "lost in transit"]))
            store(AttemptFinished(name, outcome, good, good, failure, Evidence(0.03), 12.0, 700.0))
            if i % 5 == 4:
                store(RoundFinished(0, i // 5, 5, StopReason.CLEARED))
        store(RunFinished("finished"))
        store.close()
    return folder


def timed(attempts: int) -> dict[str, float]:
    """Seconds that statistics and report take, and how large the log is."""
    with tempfile.TemporaryDirectory() as root:
        folder = big_log(Path(root) / "run", attempts)
        seconds = {}
        for name, action in (("stats_s", lambda: summary(folder)), ("report_s", lambda: page(read_rows(folder)))):
            start = time.perf_counter()
            action()
            seconds[name] = round(time.perf_counter() - start, 3)
        return {"attempts": attempts, **seconds, "rows_mb": (folder / "trials.sqlite").stat().st_size / 1e6}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--attempts", type=int, default=10_000)
    sys.stdout.write(json.dumps(timed(parser.parse_args().attempts)) + "\n")
