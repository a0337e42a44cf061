"""Kills a whole simulated run (physics, camera, planner, motion, log) at random moments and looks at what it left.

`python tests/trials/kill_sim.py --kills 200 --out FILE` measures docs/trials.md; it goes on where FILE ends.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from kill_harness import Found, look

from evg_app.cli.lab import SimLab, build_lab, loop_context
from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.events import AttemptFinished, fan_out
from evg_app.grasping.load import load_planner
from evg_app.motion.feasibility import MotionPlanner
from evg_app.picking.run import run_rounds
from evg_app.trials.film import Film
from evg_app.trials.recorder import Recorder

EVENTS = 64
"""The latest kill comes after so many events: more than one attempt."""
LATER_S = 0.1
"""And up to so long after one [s]."""


class Rehearsed:
    """Everything a run needs, made once; every kill gets a copy of this process.

    Attributes:
        lab: simulated devices, and who sets the table.
    """

    def __init__(self) -> None:
        self.robot, self.camera = load_robot("panda"), load_camera("d435i")
        self.planner, self.motion = load_planner("antipodal"), MotionPlanner(self.robot)
        self.lab: SimLab = build_lab(self.robot, self.camera, load_world("packed"), None, False, None)
        self._set: list[int | None] = [self.lab.rounds.prepare(0, 0)]

    def prepare(self, round_index: int, seed: int) -> int | None:
        """The table is set once, before all kills; a run that comes to another round sets it anew."""
        return self._set.pop() if self._set else self.lab.rounds.prepare(round_index, seed)

    def run(self, folder: Path, told: int, seed: int) -> None:
        """A run of many rounds; events (".") and finished attempts are told to the parent, the log served between."""

        def tell(event):
            """One event is about to be logged."""
            os.write(told, b".\n")

        def finished(event):
            """One event was logged."""
            if isinstance(event, AttemptFinished):
                os.write(told, f"{event.attempt_id}\n".encode())

        film, lab = Film(), self.lab
        with Recorder(folder, {}, {}, film, False) as recorder, lab.camera, lab.arm, lab.gripper:
            sink = fan_out(tell, recorder, finished)
            ctx = loop_context(lab, self.robot, self.camera, self.planner, self.motion, sink, film)
            run_rounds(ctx, self, (seed,), 1000)


def kill_once(rehearsed: Rehearsed, folder: Path, seed: int, events: int, later: float) -> list[str]:
    """Ids of attempts that were finished when the run was killed `later` [s] after its event number `events`."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            rehearsed.run(folder, writing, seed)
        finally:
            os._exit(1)
    os.close(writing)
    told: list[str] = []
    with os.fdopen(reading, "rb") as lines:
        for line in lines:
            if line == b".\n":
                events -= 1
                if events == 0:
                    time.sleep(later)
                    os.kill(child, signal.SIGKILL)
            elif line.endswith(b"\n"):
                told.append(line.decode().strip())
    os.waitpid(child, 0)
    assert events <= 0, "the run ended by itself"
    return told


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=1e9, help="stop for now after so long")
    words = parser.parse_args()
    done = len(words.out.read_text().splitlines()) if words.out.exists() else 0
    rehearsed, begun = Rehearsed(), time.monotonic()
    for i in range(done, words.kills):
        if time.monotonic() - begun > words.seconds:
            break
        rng, found = np.random.default_rng([8, i]), Found(kills=1)
        with tempfile.TemporaryDirectory() as root:
            folder = Path(root) / "run"
            events, later = int(rng.integers(1, EVENTS)), float(rng.uniform(0, LATER_S))
            look(folder, kill_once(rehearsed, folder, i, events, later), found)
        with words.out.open("a") as out:
            out.write(json.dumps(found.__dict__) + "\n")
    rows = [json.loads(line) for line in words.out.read_text().splitlines()]
    sums = {name: sum(r[name] if isinstance(r[name], int) else len(r[name]) for r in rows) for name in rows[0]}
    sys.stdout.write(json.dumps(sums) + "\n")
