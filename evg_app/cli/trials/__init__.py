"""`evg-app trials`: what the trial log says, and what may be done with it. One file per verb."""

from typing import Any

from evg_app.cli.trials import check, compare, export, label, prune, replay, report, stats
from evg_app.cli.trials.common import write_json_file as write_json_file

VERBS = (stats, compare, report, replay, label, export, prune, check)


def add_parser(subparsers: Any) -> None:
    """Add the verb `trials` with its own verbs."""
    top = subparsers.add_parser("trials", help="statistics, comparison, report, replay and export of recorded runs")
    verbs = top.add_subparsers(dest="trials_verb", required=True, metavar="VERB")
    for verb in VERBS:
        verb.add_parser(verbs)
