"""`evg-app trials`: what the trial log says, and what may be done with it. One file per verb."""

import importlib
from typing import Any

from evg_app.cli.trials.common import write_json_file as write_json_file

VERBS = ("stats", "compare", "report", "replay", "label", "export", "prune", "check")
"""Modules of this package."""


def add_parser(subparsers: Any, verb: str = "") -> None:
    """Add the verb `trials` with its own verbs; if `verb` is one of them, only that one is imported."""
    top = subparsers.add_parser("trials", help="statistics, comparison, report, replay and export of recorded runs")
    verbs = top.add_subparsers(dest="trials_verb", required=True, metavar="VERB")
    for name in (verb,) if verb in VERBS else VERBS:
        importlib.import_module(f"evg_app.cli.trials.{name}").add_parser(verbs)
