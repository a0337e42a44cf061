"""A recorded run in the window: a slider over its passes, and buttons for a person's label."""

import threading
from pathlib import Path
from typing import Any

from evg_app.config.models import RobotConfig
from evg_app.errors import BadInput, EvgError
from evg_app.trials.labels import VIEWER, add_label
from evg_app.trials.recorded import RecordedRun
from evg_app.trials.rows import read_rows
from evg_app.viewer import text
from evg_app.viewer.counters import Counters
from evg_app.viewer.drawing import drawing
from evg_app.viewer.text import LABELS
from evg_app.viewer.window import Window


def robot_of(run: RecordedRun) -> RobotConfig:
    """The robot that a run was made with.

    Raises:
        BadInput: its configuration was not logged, or is not one of this version.
    """
    for session in run.sessions.values():
        try:
            return RobotConfig.model_validate(session.config["robot"])
        except (KeyError, ValueError) as error:
            raise BadInput(f"{run.folder}: the logged robot is not readable by this version: {error}") from error
    raise BadInput(f"{run.folder} holds a trial log without a run: it was interrupted while starting")


class RecordedView:
    """Shows a run folder in a window, the last pass first.

    Args:
        window: it.
        run: the folder.

    Raises:
        BadInput: it holds no finished pass whose arrays are kept.
    """

    def __init__(self, window: Window, run: RecordedRun) -> None:
        if not run.attempt_ids:
            raise BadInput(f"{run.folder} holds no finished pass whose arrays are kept. Name another run")
        self._window, self._run = window, run
        self._busy = threading.Lock()
        gui, last = window.server.gui, len(run.attempt_ids) - 1
        self._slider: Any = gui.add_slider(
            "pass", min=0, max=max(last, 1), step=1, initial_value=last, disabled=last == 0, order=10
        )
        self._slider.on_update(lambda _: self.show(min(int(self._slider.value), last)))
        buttons = gui.add_button_group("label it", tuple(LABELS), order=25)
        buttons.on_click(lambda _: self.label(str(buttons.value)))
        self.count()
        self.show(last)

    def show(self, number: int) -> None:
        """Show the pass of this number, counted from 0 over the run."""
        with self._busy:
            try:
                attempt = self._run.attempt(self._run.attempt_ids[number])
            except EvgError as error:
                self._window.say([f"pass {number} cannot be shown", str(error)])
                return
            words = text.attempt(attempt.seed, attempt.round_index, attempt.index, attempt.outcome, attempt.failure)
            if attempt.intact is False:
                words.append("the arrays file was changed after it was recorded")
            self._window.show(drawing(attempt.stored), [*words, f"id {attempt.attempt_id}"])

    def count(self) -> None:
        """Count the run anew."""
        self._window.count([Path(self._run.folder).name, *Counters.of(read_rows(self._run.folder)).lines()])

    def label(self, word: str) -> None:
        """Keep a person's word, one of `LABELS`, about the pass that is shown."""
        attempt_id = self._run.attempt_ids[min(int(self._slider.value), len(self._run.attempt_ids) - 1)]
        try:
            add_label(self._run.folder, attempt_id, LABELS[word], VIEWER)
            self.count()
        except EvgError as error:
            self._window.say(["the label was not kept", str(error)])
