"""`evg-app generate`: labelled scenes for training."""

import argparse
import time
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from evg_app.cli.console import say

if TYPE_CHECKING:
    from evg_app.learning.generate import ShardReport
    from evg_app.learning.verification import Agreement

SUMMARY = "generate labelled scenes for training"


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb `generate`."""
    parser = subparsers.add_parser("generate", help=SUMMARY, description=SUMMARY)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder of shards; missing ones are made"
    )
    parser.add_argument("--scenes", type=int, default=5000, help="how many, in shards of 50 (default 5000)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--packed-objects", type=Path, action="append", default=[], metavar="DIR", help=_FOLDER)
    parser.add_argument("--pile-objects", type=Path, action="append", default=[], metavar="DIR", help=_FOLDER)
    parser.add_argument("--weights", type=Path, metavar="FILE", help="add this network's own proposals, with labels")
    parser.add_argument("--proposals", type=int, default=60, metavar="N", help="so many per scene (default 60)")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes (default 1)")
    parser.add_argument(
        "--from-trials",
        type=Path,
        action="append",
        default=[],
        metavar="RUN",
        help="make shards of this run folder's attempts instead of new scenes; may be given several times",
    )
    parser.set_defaults(run=run)


_FOLDER = "folder of URDFs in VGN's layout to use beside the built-in training objects; may be given several times"


def run(args: argparse.Namespace) -> int:
    """Make the missing shards. Returns 0."""
    if args.from_trials:
        return _from_trials(args)
    from evg_app.learning.generate import GenerateConfig, generate

    config = GenerateConfig(
        seed=args.seed,
        scenes=args.scenes,
        packed_folders=tuple(str(p) for p in args.packed_objects),
        pile_folders=tuple(str(p) for p in args.pile_objects),
        weights=str(args.weights) if args.weights else None,
        proposals=args.proposals,
    )
    course = _Course()
    made = generate(config, args.out, args.workers, course)
    say(f"{made} of {config.shards} shards made in {args.out}; the others were there")
    if made:
        say(course.agreement())
    return 0


class _Course:
    """Says of every shard what is in it, how fast it goes and how long the rest will take."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._scenes = 0
        self._cpu = 0.0
        self._agreements: list[Agreement] = []

    def __call__(self, report: "ShardReport", done: int, shards: int) -> None:
        from evg_app.learning.verification import as_text

        self._scenes += report.scenes
        self._cpu += report.cpu_s
        self._agreements.append(report.agreement)
        seconds = time.monotonic() - self._start
        left = timedelta(seconds=round(seconds / done * (shards - done)))
        say(
            f"{done}/{shards} {report.name}: {report.positives} positives, {report.slips} slips, "
            f"{report.collisions} collisions; {self._scenes / seconds:.2f} scenes/s, "
            f"{self._cpu / self._scenes:.2f} CPU-s a scene, {left} left"
        )
        say(f"    agree with physics: {as_text(report.agreement)}")

    def agreement(self) -> str:
        """How all labels that physics tried fared."""
        from evg_app.learning.verification import as_text, total

        return f"labels that agree with physics: {as_text(total(self._agreements))}"


def _from_trials(args: argparse.Namespace) -> int:
    from evg_app.learning.from_trials import shards_from_trials

    found = shards_from_trials(args.from_trials, args.out)
    say(f"{found.used} attempts in {args.out}, {found.positives} of them successes; {found.left_out} teach nothing")
    return 0
