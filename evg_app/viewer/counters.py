"""The numbers beside the picture: grasp success and declutter rate with Wilson intervals."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from evg_app.events import AttemptFinished, AttemptOutcome, Event, RoundStarted
from evg_app.trials.rows import LogRows
from evg_app.trials.statistics import rate


@dataclass(frozen=True)
class Counters:
    """How a run stands.

    Attributes:
        successes, attempts: grasps that ended in the bin, of those executed.
        removed, objects: over all rounds so far; `objects` is None when nobody counted them.
        passes: through the loop, those without a grasp included.
        words: attempts that a person's word counts for, and what it was.
    """

    successes: int = 0
    attempts: int = 0
    removed: int = 0
    objects: int | None = 0
    passes: int = 0
    words: Mapping[str, bool] = field(default_factory=dict)

    @staticmethod
    def of(rows: LogRows) -> "Counters":
        """Of a run folder, the operator's labels counted."""
        gsr, dr = rows.gsr_counts, rows.dr_counts
        removed, objects = (0, None) if dr is None else (dr.k, dr.n)
        return Counters(gsr.k, gsr.n, removed, objects, len(rows.passes))

    def after(self, event: Event) -> "Counters":
        """With one more event of the live stream; the loop's own outcome counts."""
        if isinstance(event, RoundStarted):
            objects = None if self.objects is None or event.objects is None else self.objects + event.objects
            return replace(self, objects=objects)
        if isinstance(event, AttemptFinished):
            won = int(event.outcome is AttemptOutcome.SUCCESS)
            attempts, removed = self.attempts + int(event.outcome.counts), self.removed + won
            return replace(
                self, successes=self.successes + won, attempts=attempts, removed=removed, passes=self.passes + 1
            )
        return self

    def labelled(self, attempt: AttemptFinished, success: bool | None) -> "Counters":
        """With a person's word about an executed grasp; None takes an earlier word back."""
        own = attempt.outcome is AttemptOutcome.SUCCESS
        more = int(own if success is None else success) - int(self.words.get(attempt.attempt_id, own))
        words = {**self.words, attempt.attempt_id: own if success is None else success}
        return replace(self, successes=self.successes + more, removed=self.removed + more, words=words)

    def lines(self) -> list[str]:
        """For people."""
        removed = "objects not counted" if self.objects is None else rate(min(self.removed, self.objects), self.objects)
        return [f"GSR {rate(self.successes, self.attempts)}", f"DR {removed}", f"{self.passes} passes"]
