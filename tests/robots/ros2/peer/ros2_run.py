"""`evg-app run --driver ros2` against the peer: the command itself, all but the camera, which is the peer's.

Example: `.venv-ros/bin/python tests/robots/ros2/peer/ros2_run.py --scene packed --rounds 10 --json out.json`
Every round is one whole run: connect, judge the depth, pick until the table is clear, disconnect. The truth stays with
the peer and is compared afterwards; the program is told nothing but what a robot and a camera would tell it.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "fci"))

from calibrated import calibrated
from injected import heard_by
from ros2_lab import PeerCamera
from ros2_peer import PeerProcess, isolate

from evg_app.cli.main import main as evg_app
from evg_app.config.files import load_camera
from evg_app.events import AttemptFinished, Event, RoundFinished, RoundStarted
from evg_app.trials.statistics import rate, wilson

FINISHED = ("cleared", "two consecutive failures", "no grasp", "no feasible grasp", "attempt limit")
"""Reasons of its own that a round may end with; "error" and "stopped" are none."""


@dataclass
class Truth:
    """Keeps the program's judgements beside what the peer knows."""

    peer: PeerProcess
    pairs: list[tuple[bool, bool]] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    reason: str = ""
    detail: str = ""
    in_bin: int = 0

    def __call__(self, event: Event) -> None:
        """Take one event of the run."""
        if isinstance(event, RoundStarted):
            self.in_bin = 0
        elif isinstance(event, AttemptFinished):
            now = int(self.peer.ask("truth")[1])
            if event.outcome.counts and event.verified is not None:
                self.pairs.append((event.verified, now > self.in_bin))
            self.failures.append(event.failure)
            self.in_bin = now
        elif isinstance(event, RoundFinished):
            self.reason, self.detail = str(event.stop_reason.value), event.detail


@contextmanager
def seen_by(peer: PeerProcess, truth: Truth) -> Iterator[None]:
    """While inside, `evg-app run` sees through the peer's camera, and `truth` hears its events."""

    camera = mock.patch("evg_app.cli.real_lab._camera", lambda wishes, config, clock, sink: PeerCamera(peer, clock))
    with camera, heard_by(truth):
        yield


def one_round(peer: PeerProcess, folder: Path, number: int, seed: int, model: str) -> tuple[Truth, dict[str, Any]]:
    """One table, one run of the program; its exit code and what became of it."""
    objects, truth = int(peer.ask("round", number, seed)), Truth(peer)
    words = ["--robot", "panda", "--driver", "ros2", "--camera", "d435i", "--model", model, "--confirm-speed", "1"]
    places = ["--config-dir", str(folder), "--run-dir", str(folder / f"run-{number:02d}"), "--seed", str(seed)]
    with seen_by(peer, truth):
        code = evg_app(["run", *words, *places])
    on_table, in_bin = peer.ask("truth")
    facts = {"round": number, "exit_code": code, "reason": truth.reason, "detail": truth.detail, "objects": objects}
    return truth, facts | {"in_bin": in_bin, "on_table": on_table, "judged_and_true": truth.pairs}


def summary(rounds: list[dict[str, Any]], command: str) -> dict[str, Any]:
    """Rates over all rounds."""

    def share(k: int, n: int) -> list[float]:
        """k, n and the 95 % interval."""
        return [k, n, *wilson(k, n)]

    pairs = [pair for facts in rounds for pair in facts["judged_and_true"]]
    held = [true for judged, true in pairs if judged]
    done = sum(facts["exit_code"] == 0 and facts["reason"] in FINISHED for facts in rounds)
    return {
        "command": command,
        "rounds_completed": share(done, len(rounds)),
        "grasps_in_the_bin": share(sum(true for _, true in pairs), len(pairs)),
        "objects_removed": share(sum(f["in_bin"] for f in rounds), sum(f["objects"] for f in rounds)),
        "held_verdicts_that_are_true": share(sum(held), len(held)),
        "judgements_that_are_true": share(sum(judged == true for judged, true in pairs), len(pairs)),
        "load_average": os.getloadavg(),
        "rounds": rounds,
    }


def main() -> None:
    """Run the rounds, and write what happened after each."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--scene", default="packed")
    parser.add_argument("--model", default="equiigd")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--first", type=int, default=0, help="number of the first round")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--objects", type=int, default=5)
    parser.add_argument("--json", type=Path, required=True, help="earlier rounds in it are kept")
    args = parser.parse_args()
    isolate()
    rounds = json.loads(args.json.read_text())["rounds"] if args.json.exists() else []
    peer = PeerProcess("--scene", args.scene, "--objects", str(args.objects))
    try:
        with tempfile.TemporaryDirectory() as name:
            calibrated(Path(name), load_camera("d435i"), peer.ask("camera_pose"))
            for number in range(args.first, args.first + args.rounds):
                truth, facts = one_round(peer, Path(name), number, args.seed, args.model)
                rounds.append(facts | {"failures": truth.failures})
                args.json.write_text(
                    json.dumps(summary(rounds, " ".join(["ros2_run.py", *sys.argv[1:]])), indent=1) + "\n"
                )
                sys.stdout.write(f"round {number}: {facts['reason']}, exit {facts['exit_code']}\n")
    finally:
        peer.close()
    done = summary(rounds, "")["rounds_completed"]
    sys.stdout.write(f"rounds that ended with a reason of their own: {rate(done[0], done[1])}\n")


if __name__ == "__main__":
    main()
