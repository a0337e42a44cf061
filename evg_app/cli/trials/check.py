"""`evg-app trials check`: intervals for a published table, and its cells that do not add up."""

import argparse
from pathlib import Path
from typing import Any

from evg_app.cli.console import say
from evg_app.cli.trials.common import add_json, write_json_file
from evg_app.trials.published import read_table


def add_parser(verbs: Any) -> None:
    """Add the verb `check`."""
    parser = verbs.add_parser(
        "check",
        help="intervals for a published table, and cells whose percentage does not follow from its counts",
        description="CSV with columns method, scene, successes, attempts, gsr_percent and optionally dr_percent, "
        "objects. Example: docs/results/paper_real_robot.csv",
    )
    parser.add_argument("table", type=Path, metavar="CSV")
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print every cell with its interval, marking those that do not add up. Returns 0.

    Raises:
        BadInput: the table cannot be read.
    """
    cells = read_table(args.table)
    for cell in cells:
        say(cell.line())
    wrong = sum(bool(cell.problems()) for cell in cells)
    say(f"{wrong} of {len(cells)} cells have a percentage that does not follow from their counts")
    write_json_file(args.json, [cell.facts() for cell in cells])
    return 0
