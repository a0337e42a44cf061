"""The person beside the robot: sets up rounds by a protocol, and says what became of each attempt."""

from collections.abc import Callable

from evg_app.config.protocol import ProtocolConfig
from evg_app.events import AttemptFinished, AttemptStarted, Event, Verified
from evg_app.trials.protocol import plan_round

Ask = Callable[[str], str]
"""Shows a text and returns what the person typed, without the line's end."""
Labeller = Callable[[str, bool | None], None]
"""Keeps a label: attempt id, and success or None for "cannot tell"."""

QUESTION = "Is an object more in the bin? [y]es, [n]o, [?] cannot tell: "
ANSWERS = {"y": True, "yes": True, "n": False, "no": False, "?": None, "": None}


class Scorekeeper:
    """Implements `picking.context.Rounds` and `Referee`, and listens to the events.

    The automatic judgement (is something between the fingers, at the lift and above the bin) is kept beside the
    operator's. Where the operator cannot tell, the automatic one counts.

    Args:
        protocol: what is asked for.
        ask: how to ask.
        say: how to tell.
        label: keeps a label in the log.
    """

    def __init__(self, protocol: ProtocolConfig, ask: Ask, say: Callable[[str], None], label: Labeller) -> None:
        self._protocol, self._ask, self._say, self._label = protocol, ask, say, label
        self._binned, self._objects = 0, protocol.objects_per_round
        self._asked_before, self._held = False, False
        self._answer: bool | None = None
        self._answered = False

    def prepare(self, round_index: int, seed: int) -> int:
        """Tell the operator what to place, and wait until it is done. Returns the number of objects."""
        for line in plan_round(self._protocol, round_index, seed).lines(self._protocol):
            self._say(line)
        self._ask("Press Enter when the scene is ready: ")
        self._binned = 0
        return self._objects

    def in_bin(self) -> int:
        """Objects of this round in the bin. The second call of an attempt asks."""
        if not self._asked_before:
            self._asked_before = True
            return self._binned
        if not self._answered:
            self._answer, self._answered = self._ask_for_label(), True
            self._binned += self._held if self._answer is None else self._answer
        return self._binned

    def on_table(self) -> int:
        """Objects of this round that are not in the bin."""
        return max(self._objects - self._binned, 0)

    def __call__(self, event: Event) -> None:
        """Follow the attempt; keep its label once it is in the log."""
        if isinstance(event, AttemptStarted):
            self._asked_before, self._answered, self._held, self._answer = False, False, False, None
        elif isinstance(event, Verified):
            self._held = event.held
        elif isinstance(event, AttemptFinished) and self._answered:
            self._label(event.attempt_id, self._answer)

    def _ask_for_label(self) -> bool | None:
        """The operator's word, asked until it is one."""
        if self._protocol.label == "never":
            return None
        while True:
            word = self._ask(QUESTION).strip().lower()
            if word in ANSWERS:
                return ANSWERS[word]
            self._say("please type y, n or ?")
