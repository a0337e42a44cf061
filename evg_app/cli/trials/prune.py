"""`evg-app trials prune`: what a run takes on the disk, and less of it."""

import argparse
from pathlib import Path
from typing import Any

from evg_app.cli.console import say
from evg_app.trials.keep import POLICIES, prune, sizes


def add_parser(verbs: Any) -> None:
    """Add the verb `prune`."""
    parser = verbs.add_parser(
        "prune",
        help="say what a run takes on the disk; with --keep, delete arrays that are not kept",
        description="Rows and pictures always stay, so statistics and reports do not change; an attempt without its "
        "arrays cannot be replayed any more.",
    )
    parser.add_argument("run_folder", type=Path, metavar="RUN")
    parser.add_argument("--keep", choices=list(POLICIES), help="which attempts keep their arrays")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Say the sizes; delete with `--keep`. Returns 0.

    Raises:
        BadInput: the log cannot be read or written.
    """
    if args.keep is not None:
        files, freed = prune(args.run_folder, args.keep)
        say(f"deleted the arrays of {files} attempts, {freed / 1e6:.1f} MB")
    size = sizes(args.run_folder)
    n = size["attempts_with_arrays"]
    each = f", {size['arrays'] / n / 1e3:.0f} kB each" if n else ""
    say(f"rows {size['rows'] / 1e6:.2f} MB, pictures {size['pictures'] / 1e6:.1f} MB")
    say(f"arrays of {n} attempts {size['arrays'] / 1e6:.1f} MB{each}")
    return 0
