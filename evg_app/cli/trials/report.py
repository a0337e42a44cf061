"""`evg-app trials report`: one HTML file that says what a run was worth.

Example: `evg-app trials report runs/20260101-120000-abcdef --out report.html`
"""

import argparse
from pathlib import Path
from typing import Any

from evg_app.cli.console import say
from evg_app.cli.trials.common import add_run, chosen_run
from evg_app.errors import BadInput
from evg_app.trials.arrays import write_atomically
from evg_app.trials.page import page
from evg_app.trials.rows import read_rows

DEFAULT = "report.html"
"""Where it goes, in the run folder."""


def add_parser(verbs: Any) -> None:
    """Add the verb `report`."""
    parser = verbs.add_parser(
        "report",
        help="one self-contained HTML file: rates, plots, best and worst attempts, hashes",
        description="Write one HTML file that needs nothing else: rates with intervals, plots, best and worst attempts "
        "as pictures, configuration, calibration and weights hashes.",
    )
    add_run(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help=f"default: {DEFAULT} in the run folder")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the report. Returns 0.

    Raises:
        BadInput: there is no such run, or FILE cannot be written.
    """
    folder = chosen_run(args)
    target: Path = args.out or folder / DEFAULT
    text = page(read_rows(folder))
    try:
        write_atomically(target, text.encode("utf-8"))
    except OSError as error:
        raise BadInput(f"{target} cannot be written: {error.strerror}. Name another file with --out") from error
    say(f"report: {target} ({len(text) / 1e6:.1f} MB)")
    return 0
