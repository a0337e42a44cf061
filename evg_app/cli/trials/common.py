"""What the verbs of `evg-app trials` share."""

import argparse
import json
from pathlib import Path
from typing import Any

from evg_app.errors import BadInput
from evg_app.trials.folder import newest


def add_run(parser: argparse.ArgumentParser) -> None:
    """The run folder, the newest by default."""
    parser.add_argument(
        "run_folder", nargs="?", type=Path, metavar="RUN", help="a run folder (default: newest in runs/)"
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Where the numbers go."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the numbers to FILE, rates as fractions")


def chosen_run(args: argparse.Namespace) -> Path:
    """The run folder that was named, or the newest.

    Raises:
        BadInput: there is none.
    """
    folder: Path = args.run_folder or newest()
    return folder


def write_json_file(path: Path | None, facts: Any) -> None:
    """Write a result file that the user named, if any.

    Raises:
        BadInput: it cannot be written.
    """
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise BadInput(f"--json {path} cannot be written: {error.strerror}. Name a file you may write") from error
