"""`--view`: the run in the browser while it goes on."""

import argparse
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

from evg_app.cli.console import say
from evg_app.cli.view import add_address
from evg_app.config.models import RobotConfig
from evg_app.events import Event, Sink


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare `--view` and its address."""
    group = parser.add_argument_group("live view")
    group.add_argument("--view", action="store_true", help="show the run in the browser (extra: viewer)")
    add_address(group, "--view-")


@contextmanager
def live_view(args: argparse.Namespace, robot: RobotConfig) -> Iterator[Sink]:
    """A sink that feeds the browser while inside; one that does nothing without `--view`.

    Raises:
        EvgError: the extra `viewer` is missing, or nobody can listen there.
    """
    if not args.view:
        yield _nobody
        return
    from evg_app.viewer.live import LiveView, add_stop, shown_in
    from evg_app.viewer.window import Window

    with Window(robot, args.view_host, args.view_port) as window:
        live = LiveView(shown_in(window))
        add_stop(window, _as_ctrl_c)
        say(f"live view: {window.url}")
        try:
            yield live
        finally:
            live.close()


def _as_ctrl_c() -> None:
    """What Ctrl-C does: once the run ends after this pass, twice it stops now."""
    os.kill(os.getpid(), signal.SIGINT)


def _nobody(_event: Event) -> None:
    """Nobody looks."""
