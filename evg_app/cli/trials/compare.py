"""`evg-app trials compare`: is one run better than another?

Example: `evg-app trials compare runs/with runs/without --json difference.json`
"""

import argparse
from pathlib import Path
from typing import Any

from evg_app.cli.console import say
from evg_app.cli.trials.common import add_json, write_json_file
from evg_app.trials.rows import read_rows
from evg_app.trials.verdict import compare, lines


def add_parser(verbs: Any) -> None:
    """Add the verb `compare`."""
    parser = verbs.add_parser(
        "compare",
        help="two runs: difference with interval, exact and sequential tests, trials still needed",
        description="GSR and DR of two runs. Fixed-sample p-values are for two finished runs; the sequential ones may "
        "be looked at after every attempt.",
    )
    parser.add_argument("a", type=Path, metavar="RUN_A")
    parser.add_argument("b", type=Path, metavar="RUN_B")
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compare two runs. Returns 0.

    Raises:
        BadInput: one of them cannot be read.
    """
    facts = compare(read_rows(args.a), read_rows(args.b))
    for line in lines(facts):
        say(line)
    write_json_file(args.json, facts)
    return 0
