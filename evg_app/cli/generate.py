"""`evg-app generate`: labelled scenes for training."""

import argparse
import logging
from pathlib import Path

from evg_app.cli.console import say

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

    logging.getLogger("evg_app").setLevel(logging.INFO)
    config = GenerateConfig(
        seed=args.seed,
        scenes=args.scenes,
        packed_folders=tuple(str(p) for p in args.packed_objects),
        pile_folders=tuple(str(p) for p in args.pile_objects),
        weights=str(args.weights) if args.weights else None,
        proposals=args.proposals,
    )
    generate(config, args.out, args.workers)
    return 0


def _from_trials(args: argparse.Namespace) -> int:
    from evg_app.learning.from_trials import shards_from_trials

    found = shards_from_trials(args.from_trials, args.out)
    say(f"{found.used} attempts in {args.out}, {found.positives} of them successes; {found.left_out} teach nothing")
    return 0
