"""Everything a run leaves in its folder, fed by one sink."""

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from evg_app.events import AttemptFinished, AttemptStarted, Event, RunFinished
from evg_app.trials import folder as folders
from evg_app.trials.arrays import Gathered, write_atomically, write_json
from evg_app.trials.errors import LogError
from evg_app.trials.film import Film
from evg_app.trials.pictures import draw, png
from evg_app.trials.schema import open_to_write
from evg_app.trials.store import Placement, TrialStore
from evg_app.trials.summary import summary

FILM_FILE = "run.gif"
SUMMARY_FILE = "summary.json"


class Recorder:
    """The trial log, a picture per attempt, a film and a summary. An event sink and a context manager.

    Args:
        folder: a run folder that does not exist yet or is empty.
        config: JSON-able snapshot of everything that configures the run.
        film: gets the pictures of the attempts unless `pictures_in_film` is False; others may add to it.
        resume: go on in a folder that holds an earlier session.
        placement: what a round (seed, index) asks of the operator.

    Raises:
        BadInput: the folder exists with content (or, to resume, without a log) or cannot be written.
        LogError: later, from an event, when the disk does not take it.
    """

    def __init__(
        self,
        folder: Path,
        config: Mapping[str, Any],
        facts: Mapping[str, Any] | None = None,
        film: Film | None = None,
        pictures_in_film: bool = True,
        resume: bool = False,
        placement: Placement | None = None,
    ) -> None:
        self.folder = folder if resume else folders.make(folder)
        if resume:
            open_to_write(folder).close()
        self.store = TrialStore(self.folder, config, facts, placement)
        self.film = Film() if film is None else film
        self._pictures_in_film = pictures_in_film
        self._gathered, self._label = Gathered(), ""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.store.close()

    def __call__(self, event: Event) -> None:
        """Take one event."""
        self.store(event)
        self._gathered.take(event)
        if isinstance(event, AttemptStarted):
            self._gathered = Gathered()
            self._label = f"seed {event.seed}  round {event.round_index}  attempt {event.index}"
        try:
            if isinstance(event, AttemptFinished):
                self._picture(event)
            elif isinstance(event, RunFinished):
                self._finish()
        except OSError as error:
            raise LogError(str(self.folder), str(error)) from error

    def _picture(self, event: AttemptFinished) -> None:
        """Draw the attempt and keep the picture."""
        caption = f"{self._label}: {event.outcome}{f' ({event.failure})' if event.failure else ''}"
        image = draw(self._gathered, caption)
        if image is not None:
            write_atomically(self.folder / folders.ATTEMPTS / f"{event.attempt_id}.png", png(image))
            if self._pictures_in_film:
                self.film.add(image)

    def _finish(self) -> None:
        """Write film and summary."""
        self.film.save(self.folder / FILM_FILE)
        write_json(self.folder / SUMMARY_FILE, summary(self.folder))
