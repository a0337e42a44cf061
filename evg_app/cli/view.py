"""`evg-app view`: look at a recorded run in the browser.

Example: `evg-app view runs/20260101-120000-abcdef`
"""

import argparse
import threading

from evg_app.cli.arguments import port
from evg_app.cli.console import say
from evg_app.cli.trials.common import add_run, chosen_run
from evg_app.viewer.window import DEFAULT_PORT, LOCAL


def add_address(parser: argparse.ArgumentParser | argparse._ArgumentGroup, prefix: str = "--") -> None:
    """Where browsers find the view: `<prefix>host` and `<prefix>port`."""
    parser.add_argument(
        f"{prefix}host",
        default=LOCAL[0],
        metavar="H",
        help="address to listen on (default: only this machine); any other wants the token in the printed URL",
    )
    parser.add_argument(f"{prefix}port", type=port, default=DEFAULT_PORT, metavar="P", help=f"default: {DEFAULT_PORT}")


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("view", help="look at a recorded run in the browser", description=__doc__)
    add_run(parser)
    add_address(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Serve the view until Ctrl-C. Returns 0.

    Raises:
        EvgError: no such run, the extra `viewer` is missing, or nobody can listen there.
    """
    from evg_app.trials.recorded import RecordedRun
    from evg_app.viewer.recorded import RecordedView, robot_of
    from evg_app.viewer.window import Window

    recorded = RecordedRun(chosen_run(args))
    with Window(robot_of(recorded), args.host, args.port) as window:
        RecordedView(window, recorded)
        say(f"{len(recorded.attempt_ids)} passes of {recorded.folder} at {window.url}  (Ctrl-C ends it)")
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            return 0
    return 0
