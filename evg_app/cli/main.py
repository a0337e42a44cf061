"""`evg-app`: parse, run the verb, turn every expected failure into one clear line and an exit code."""

import argparse
import importlib
import logging
import sys
from collections.abc import Sequence

from evg_app import __version__
from evg_app.errors import EvgError

VERBS = (
    "run",
    "calibrate",
    "workspace",
    "camera",
    "trials",
    "view",
    "doctor",
    "generate",
    "train",
    "benchmark",
    "ros",
)
"""Modules of `evg_app.cli`."""

EXIT_CODES = """exit codes: 0 finished (whatever the stop reason), 2 bad input, 3 refused (calibration, limits),
4 hardware, 130 stopped by the user"""


def parser(verb: str = "") -> argparse.ArgumentParser:
    """The parser of the command line; each verb adds its own. If `verb` is one, only that one is imported."""
    top = argparse.ArgumentParser(
        prog="evg-app",
        description="Pick objects off a table with equivariant volumetric grasping, on a robot or in simulation.",
        epilog=EXIT_CODES,
    )
    top.add_argument("--version", action="version", version=f"evg-app {__version__}")
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")
    for name in (verb,) if verb in VERBS else VERBS:
        importlib.import_module(f"evg_app.cli.{name}").add_parser(verbs)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command. Returns its exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    args = parser(words[0] if words else "").parse_args(words)
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    try:
        return int(args.run(args))
    except EvgError as error:
        sys.stderr.write(f"evg-app {args.verb}: {error}\n")
        return error.exit_code
    except KeyboardInterrupt:
        sys.stderr.write(f"evg-app {args.verb}: stopped by the user\n")
        return 130
    except BrokenPipeError:
        return 0


if __name__ == "__main__":
    raise SystemExit(main())
