"""`evg-app`: parse, run the verb, turn every expected failure into one clear line and an exit code."""

import argparse
import importlib
import logging
import sys
from collections.abc import Sequence

from evg_app import __version__
from evg_app.cli.stopping import ended_like_interrupted
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
NESTED = ("trials",)
"""Of them, those that import only the one of their own verbs that is named."""

EXIT_CODES = """exit codes: 0 finished (whatever the stop reason), 2 bad input, 3 refused (calibration, limits),
4 hardware, 130 stopped by the user"""


def parser(words: Sequence[str] = ()) -> argparse.ArgumentParser:
    """The parser of the command line; each verb adds its own. If the first word is one, only that one is imported."""
    top = argparse.ArgumentParser(
        prog="evg-app",
        description="Pick objects off a table with equivariant volumetric grasping, on a robot or in simulation.",
        epilog=EXIT_CODES,
    )
    top.add_argument("--version", action="version", version=f"evg-app {__version__}")
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")
    for name in words[:1] if words and words[0] in VERBS else VERBS:
        module = importlib.import_module(f"evg_app.cli.{name}")
        module.add_parser(verbs, *(words[1:2] if name in NESTED else ()))
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command. Returns its exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    args = parser(words).parse_args(words)
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    try:
        with ended_like_interrupted():
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
