"""The numbers beside the picture: grasp success and declutter rate with Wilson intervals."""

from dataclasses import dataclass

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
    """

    successes: int = 0
    attempts: int = 0
    removed: int = 0
    objects: int | None = 0
    passes: int = 0

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
            return Counters(self.successes, self.attempts, self.removed, objects, self.passes)
        if isinstance(event, AttemptFinished):
            won = int(event.outcome is AttemptOutcome.SUCCESS)
            attempts, removed = self.attempts + int(event.outcome.counts), self.removed + won
            return Counters(self.successes + won, attempts, removed, self.objects, self.passes + 1)
        return self

    def lines(self) -> list[str]:
        """For people."""
        removed = "objects not counted" if self.objects is None else rate(min(self.removed, self.objects), self.objects)
        return [f"GSR {rate(self.successes, self.attempts)}", f"DR {removed}", f"{self.passes} passes"]
