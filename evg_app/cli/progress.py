"""What a person sees while a run goes on: one line for every round and every pass."""

import os
import signal
from collections import Counter

from evg_app.cli.console import say
from evg_app.events import (
    AttemptFinished,
    AttemptStarted,
    DepthChecked,
    Event,
    GraspsPlanned,
    Judged,
    RoundFinished,
    RoundStarted,
    Warned,
)
from evg_app.types import Verdict


class Progress:
    """An event sink that speaks."""

    def __init__(self) -> None:
        self._label = self._seen = ""
        self._unheard = False

    def __call__(self, event: Event) -> None:
        """Take one event."""
        if isinstance(event, RoundStarted):
            objects = "objects not counted" if event.objects is None else f"{event.objects} objects"
            self._tell(f"round {event.round_index} (seed {event.seed}): {objects}")
        elif isinstance(event, AttemptStarted):
            self._label, self._seen = f"  pass {event.index}", "nothing planned"
        elif isinstance(event, GraspsPlanned):
            self._seen = f"{len(event.grasps)} grasps"
        elif isinstance(event, Judged):
            self._seen += self._judged(event)
        elif isinstance(event, AttemptFinished):
            reason = f" ({event.failure})" if event.failure else ""
            times = f"{event.compute_ms:.0f} ms computing, {event.motion_s:.1f} s moving"
            self._tell(f"{self._label}: {self._seen}; {event.outcome}{reason}; {times}")
        elif isinstance(event, RoundFinished):
            self._tell(f"  ended: {event.stop_reason}{f': {event.detail}' if event.detail else ''}")
        elif isinstance(event, DepthChecked):
            self._tell(f"camera: {event.text}")
        elif isinstance(event, Warned):
            self._tell(f"{self._label or '  before'}: warning: {event.text}")

    def _tell(self, text: str) -> None:
        """Say it. When nobody can hear it (the pipe was closed), be silent and end the run as one Ctrl-C does."""
        if self._unheard:
            return
        try:
            say(text)
        except OSError:
            self._unheard = True
            os.kill(os.getpid(), signal.SIGINT)

    @staticmethod
    def _judged(event: Judged) -> str:
        """Which candidate was chosen, and why others were not."""
        reasons = Counter(v for v in event.verdicts if v not in (Verdict.ACCEPTED, Verdict.NOT_EXAMINED))
        rejected = ", ".join(f"{reason} {n}" for reason, n in reasons.most_common())
        chosen = "none feasible" if event.chosen is None else f"number {event.chosen + 1} chosen"
        return f", {chosen}{f' (rejected: {rejected})' if rejected else ''}"


def say_warning(event: Event) -> None:
    """An event sink that speaks of warnings only."""
    if isinstance(event, Warned):
        say(f"warning: {event.text}")
