"""`evg-app trials`: what the trial log says."""

import argparse
import json
from pathlib import Path
from typing import Any

from evg_app.cli.console import say
from evg_app.errors import BadInput
from evg_app.trials.folder import newest
from evg_app.trials.report import report
from evg_app.trials.summary import summary


def add_parser(subparsers: Any) -> None:
    """Add the verb `trials` with its verb `stats`."""
    top = subparsers.add_parser("trials", help="statistics of recorded runs")
    verbs = top.add_subparsers(dest="trials_verb", required=True, metavar="VERB")
    stats = verbs.add_parser(
        "stats",
        help="success rates with 95 %% intervals, picks per hour, reasons, times",
        description="Print GSR and DR (k/n, percent, Wilson 95 %), picks per hour, reasons of failure, stage times.",
    )
    stats.add_argument(
        "run_folder", nargs="?", type=Path, metavar="RUN", help="a run folder (default: newest in runs/)"
    )
    stats.add_argument("--json", type=Path, metavar="FILE", help="also write the numbers to FILE, rates as fractions")
    top.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print one run's statistics. Returns the exit code.

    Raises:
        BadInput: there is no such run, or FILE cannot be written.
    """
    folder = args.run_folder or newest()
    facts = summary(folder)
    say(report(facts))
    if args.json is not None:
        write_json_file(args.json, facts)
    return 0


def write_json_file(path: Path, facts: dict[str, Any]) -> None:
    """Write a result file that the user named.

    Raises:
        BadInput: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise BadInput(f"--json {path} cannot be written: {error.strerror}. Name a file you may write") from error
