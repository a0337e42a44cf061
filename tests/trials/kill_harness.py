"""Kills a recording process at random moments and looks at what it left.

`python tests/trials/kill_harness.py --kills 200` is the measurement of docs/trials.md; the tests kill less often.
"""

import argparse
import json
import os
import signal
import sqlite3
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "picking"))
from picking_fakes import Lab

from evg_app.events import AttemptFinished
from evg_app.trials import arrays
from evg_app.trials.recorder import Recorder
from evg_app.trials.schema import DATABASE
from evg_app.trials.summary import summary

ATTEMPTS = 3
"""A kill comes after fewer finished attempts than this ..."""
LONGEST_S = 0.3
"""... and up to so long after the last of them [s]."""


@dataclass
class Found:
    """What the kills did."""

    kills: int = 0
    attempts: int = 0
    corrupt: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    too_many: list[str] = field(default_factory=list)


def record(folder: Path, told: int) -> None:
    """Record attempts for ever; each finished one is told to the parent after the log returned from it."""
    lab = Lab(script="SFSML" * 100_000, objects=30)
    with Recorder(folder, {}, {}) as recorder:
        lab.listeners.append(recorder)

        def finished(event):
            if isinstance(event, AttemptFinished):
                os.write(told, f"{event.attempt_id}\n".encode())

        lab.listeners.append(finished)
        os.write(told, b"ready\n")
        lab.run(rounds=100_000)


def kill_once(folder: Path, attempts: int, delay: float) -> list[str]:
    """Ids of attempts that were finished when the recorder was killed, `delay` [s] after so many attempts."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            record(folder, writing)
        finally:
            os._exit(1)
    os.close(writing)
    with os.fdopen(reading, "rb") as lines:
        assert lines.readline() == b"ready\n"
        told = [lines.readline().decode().strip() for _ in range(attempts)]
        time.sleep(delay)
        os.kill(child, signal.SIGKILL)
        told += [line.decode().strip() for line in lines if line.endswith(b"\n")]
    os.waitpid(child, 0)
    return told


def look(folder: Path, told: list[str], found: Found) -> None:
    """What is in the folder, against what was finished."""
    name = folder.name
    db = sqlite3.connect(folder / DATABASE)
    try:
        if db.execute("PRAGMA integrity_check").fetchone()[0] != "ok":
            found.corrupt.append(f"{name}: integrity")
        stored = dict(db.execute("SELECT attempt_id, arrays FROM attempts WHERE outcome IS NOT NULL"))
    except sqlite3.DatabaseError as error:
        found.corrupt.append(f"{name}: {error}")
        return
    finally:
        db.close()
    found.lost += [attempt for attempt in told if attempt not in stored]
    if len(stored) > len(told) + 1:
        found.too_many.append(name)
    for attempt, file in stored.items():
        try:
            assert "depth" in arrays.read(folder / file)
        except Exception as error:
            found.corrupt.append(f"{attempt}: {error}")
    if stored and summary(folder)["attempts"] != len(stored):
        found.corrupt.append(f"{name}: summary")
    found.attempts += len(stored)


def kill_often(kills: int, seed: int = 0) -> Found:
    """Kill a fresh recorder `kills` times at random moments."""
    rng, found = np.random.default_rng(seed), Found()
    for i in range(kills):
        with tempfile.TemporaryDirectory() as root:
            folder = Path(root) / f"run{i}"
            told = kill_once(folder, int(rng.integers(ATTEMPTS)), float(rng.uniform(0.0, LONGEST_S)))
            look(folder, told, found)
            found.kills += 1
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    words = parser.parse_args()
    sys.stdout.write(json.dumps(kill_often(words.kills, words.seed).__dict__) + "\n")
