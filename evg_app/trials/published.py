"""Tables from papers: intervals for their counts, and cells whose percentage does not follow from them.

The file is CSV with the columns method, scene, successes, attempts, gsr_percent and, optionally, dr_percent, objects.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

from evg_app.errors import BadInput
from evg_app.trials.statistics import rate, wilson

NEEDED = ("method", "scene", "successes", "attempts", "gsr_percent")
NEARBY = 12
"""How far from a printed count another count is looked for that fits the printed percentage."""
ROUNDING = 1e-9
"""A percentage exactly between two printable values may be printed as either."""


@dataclass(frozen=True)
class Cell:
    """One printed result.

    Attributes:
        method, scene: which.
        successes, attempts: the printed counts.
        gsr_percent: as printed, with its decimals.
        dr_percent: as printed, empty without.
        objects: how many were on the table in all rounds, None when not printed.
    """

    method: str
    scene: str
    successes: int
    attempts: int
    gsr_percent: str
    dr_percent: str = ""
    objects: int | None = None

    def problems(self) -> list[str]:
        """What does not follow from the counts, empty when everything does."""
        found = []
        if not follows(self.successes, self.attempts, self.gsr_percent):
            true = 100 * self.successes / self.attempts
            hint = ", ".join(f"{k}/{n}" for k, n in fitting(self.successes, self.attempts, self.gsr_percent))
            found.append(
                f"GSR is printed as {self.gsr_percent} %, but {self.successes}/{self.attempts} = {true:.2f} %"
                + (f" ({self.gsr_percent} % would be {hint})" if hint else "")
            )
        if self.dr_percent and self.objects and not follows(self.successes, self.objects, self.dr_percent):
            true = 100 * self.successes / self.objects
            found.append(
                f"DR is printed as {self.dr_percent} %, but {self.successes}/{self.objects} objects = {true:.2f} %"
            )
        return found

    def line(self) -> str:
        """For a terminal: counts with interval, and what is wrong."""
        text = f"{self.method:<18}{self.scene:<8}{rate(self.successes, self.attempts):<32}"
        return f"{text}printed {self.gsr_percent}" + "".join(f"\n    ! {problem}" for problem in self.problems())

    def facts(self) -> dict[str, object]:
        """As JSON."""
        ci = list(wilson(self.successes, self.attempts))
        return {**self.__dict__, "gsr_ci": ci, "problems": self.problems()}


def follows(k: int, n: int, percent: str) -> bool:
    """Whether the printed percentage is 100 k / n, rounded to its own decimals."""
    decimals = len(percent.partition(".")[2])
    return abs(100 * k / n - float(percent)) <= 0.5 * 10.0**-decimals + ROUNDING


def fitting(k: int, n: int, percent: str) -> list[tuple[int, int]]:
    """Counts with one of the two changed that the percentage follows from, the nearest first; at most two."""
    found = [
        (abs(step), pair)
        for step in range(-NEARBY, NEARBY + 1)
        for pair in ((k + step, n), (k, n + step))
        if step and 0 <= pair[0] <= pair[1] and pair[1] > 0 and follows(*pair, percent)
    ]
    return [pair for _, pair in sorted(found)[:2]]


def read_table(path: Path) -> list[Cell]:
    """The cells of a CSV file.

    Raises:
        BadInput: it cannot be read, lacks a column, or holds impossible counts; the message names the line.
    """
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            reader = csv.DictReader(stream)
            missing = [name for name in NEEDED if name not in (reader.fieldnames or ())]
            if missing:
                raise BadInput(f"{path}: column {', '.join(missing)} is missing; needed: {', '.join(NEEDED)}")
            return [_cell(path, number, row) for number, row in enumerate(reader, 2)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{path} cannot be read as a table: {error}") from error


def _cell(path: Path, number: int, row: dict[str, str]) -> Cell:
    """One cell of the table, checked."""
    try:
        objects = (row.get("objects") or "").strip()
        cell = Cell(
            row["method"],
            row["scene"],
            int(row["successes"]),
            int(row["attempts"]),
            row["gsr_percent"].strip(),
            (row.get("dr_percent") or "").strip(),
            int(objects) if objects else None,
        )
        float(cell.gsr_percent), float(cell.dr_percent or 0)
    except (ValueError, TypeError, AttributeError) as error:
        raise BadInput(f"{path}:{number}: {error}") from error
    if not 0 <= cell.successes <= cell.attempts or cell.attempts == 0:
        raise BadInput(f"{path}:{number}: {cell.successes} successes in {cell.attempts} attempts is impossible")
    return cell
