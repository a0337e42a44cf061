"""`evg-app trials export`: tables as CSV, or everything on one time line as MCAP."""

import argparse
from pathlib import Path
from typing import Any

from evg_app.cli.console import say
from evg_app.cli.trials.common import add_run, chosen_run
from evg_app.errors import BadInput
from evg_app.trials.export import export_csv
from evg_app.trials.export_mcap import export_mcap


def add_parser(verbs: Any) -> None:
    """Add the verb `export`."""
    parser = verbs.add_parser(
        "export",
        help="tables as CSV, or depth, clouds, frames and events as MCAP for Foxglove",
        description="CSV: one file a table and attempts_judged.csv, into DIR. MCAP: one file, opens in Foxglove.",
    )
    add_run(parser)
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument("--csv", type=Path, metavar="DIR", help="write tables into DIR")
    kind.add_argument("--mcap", type=Path, metavar="FILE", help="write one MCAP file (extra `export`)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Export a run. Returns 0.

    Raises:
        BadInput: there is no such run, or the target cannot be written.
        MissingExtra: mcap is not installed.
    """
    folder = chosen_run(args)
    try:
        if args.csv is not None:
            files = export_csv(folder, args.csv)
            say(f"{len(files)} tables in {args.csv}")
        else:
            say(f"{export_mcap(folder, args.mcap)} messages in {args.mcap}")
    except OSError as error:
        raise BadInput(f"{error.filename} cannot be written: {error.strerror}. Name another place") from error
    return 0
