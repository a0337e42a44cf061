"""`evg-app trials stats`: one run in numbers."""

import argparse
from typing import Any

from evg_app.cli.console import say
from evg_app.cli.trials.common import add_json, add_run, chosen_run, write_json_file
from evg_app.trials.report import report
from evg_app.trials.summary import summary


def add_parser(verbs: Any) -> None:
    """Add the verb `stats`."""
    stats = verbs.add_parser(
        "stats",
        help="success rates with 95 %% intervals, picks per hour, reasons, times",
        description="Print GSR and DR (k/n, percent, Wilson 95 %), picks per hour, reasons of failure, stage times.",
    )
    add_run(stats)
    add_json(stats)
    stats.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print one run's statistics. Returns the exit code.

    Raises:
        BadInput: there is no such run, or FILE cannot be written.
    """
    facts = summary(chosen_run(args))
    say(report(facts))
    write_json_file(args.json, facts)
    return 0
