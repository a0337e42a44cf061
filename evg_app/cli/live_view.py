"""`--view`: the run in the browser while it goes on, and the person who looks at it."""

import argparse
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from evg_app.cli.console import say
from evg_app.cli.view import add_address
from evg_app.config.models import RobotConfig
from evg_app.events import Event, Sink
from evg_app.viewer.desk import Desk


@dataclass(frozen=True)
class Seen:
    """Who looks at a run: a listener, and the desk of the person in front of the browser (None without `--view`)."""

    sink: Sink
    desk: Desk | None = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare `--view`, its address, and how much a person is asked."""
    group = parser.add_argument_group("live view, and a person who watches")
    group.add_argument("--view", action="store_true", help="show the run in the browser (extra: viewer)")
    add_address(group, "--view-")
    group.add_argument("--view-paused", action="store_true", help="with --view: hold before the first motion")
    group.add_argument(
        "--confirm-grasps",
        action="store_true",
        help="ask before each grasp, in the view or else in the terminal; after a no the next best is offered",
    )


@contextmanager
def live_view(args: argparse.Namespace, robot: RobotConfig, folder: Path) -> Iterator[Seen]:
    """Feeds the browser while inside; does nothing without `--view`.

    Raises:
        EvgError: the extra `viewer` is missing, or nobody can listen there.
    """
    if not args.view:
        yield Seen(_nobody)
        return
    from evg_app.viewer.controls import Controls
    from evg_app.viewer.live import LiveView, shown_in
    from evg_app.viewer.window import Window

    with Window(robot, args.view_host, args.view_port) as window:
        live, desk = LiveView(shown_in(window), folder), Desk(args.confirm_grasps, args.view_paused)
        Controls(window, desk, _as_ctrl_c, live.label)
        say(f"live view: {window.url}")
        try:
            yield Seen(live, desk)
        finally:
            desk.close()
            live.close()


def _as_ctrl_c() -> None:
    """What Ctrl-C does: once the run ends after this pass, twice it stops now."""
    os.kill(os.getpid(), signal.SIGINT)


def _nobody(_event: Event) -> None:
    """Nobody looks."""
