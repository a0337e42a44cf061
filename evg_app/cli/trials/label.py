"""`evg-app trials label`: a person's word about a recorded attempt, beside the automatic one."""

import argparse
from pathlib import Path
from typing import Any

from evg_app.cli.console import say
from evg_app.trials.labels import add_label
from evg_app.trials.recorded import RecordedRun

WORDS = {"success": True, "failure": False, "unclear": None}


def add_parser(verbs: Any) -> None:
    """Add the verb `label`."""
    parser = verbs.add_parser(
        "label",
        help="add a person's label to an attempt; `stats` reports how labels agree",
        description="Labels are appended, the last one counts, and the automatic label is never overwritten.",
    )
    parser.add_argument("run_folder", type=Path, metavar="RUN")
    parser.add_argument("attempt", metavar="ID", help="the attempt, by the beginning of its id")
    parser.add_argument("label", choices=list(WORDS))
    parser.add_argument("--note", default="", metavar="TEXT")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Append a label. Returns 0.

    Raises:
        BadInput: there is no such attempt, or the log cannot be written.
    """
    attempt_id = RecordedRun(args.run_folder).find(args.attempt)
    add_label(args.run_folder, attempt_id, WORDS[args.label], note=args.note)
    say(f"{attempt_id}: {args.label}")
    return 0
