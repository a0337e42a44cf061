"""The accounts of a round (spec §11 check 8), with a scripted table and a scripted planner."""

import numpy as np
import pytest

from evg_app.benchmark.clutter.rounds import End, RoundResult, Tally, play
from evg_app.benchmark.clutter.summary import by_seed, paired, rates
from evg_app.errors import BadInput
from evg_app.geometry import Array
from evg_app.simulation.free_gripper import GraspOutcome
from evg_app.types import Grasps

TOLERANCE = 1e-12
ONE_GRASP = Grasps(np.eye(4)[None], np.array([0.05]), np.array([0.9]))


class ScriptedTable:
    """Executes S (held and removed), F (missed), T (touched, not held) or K (missed, and one object knocked out)."""

    def __init__(self, objects: int, script: str) -> None:
        self.objects, self._script = objects, list(script)

    def execute(self, T_task_grasp: Array) -> GraspOutcome:
        word = self._script.pop(0)
        self.objects -= word in "SK"
        return GraspOutcome(word == "S", word == "T", 0.03, 7 if word == "S" else None)


class ScriptedPlanner:
    """Answers g (a grasp), n (none) or e (the view is empty); after the script always g."""

    def __init__(self, script: str = "") -> None:
        self._script = script

    def __call__(self, attempt: int) -> Grasps | None:
        word = self._script[attempt] if attempt < len(self._script) else "g"
        return {"g": ONE_GRASP, "n": Grasps.empty(), "e": None}[word]


def played(objects: int, table: str, planner: str = "") -> tuple[Tally, End]:
    return play(ScriptedTable(objects, table), ScriptedPlanner(planner))


def row(
    seed: int, number: int, successes: int, attempts: int, objects: int, names: tuple[str, ...] = ()
) -> RoundResult:
    return RoundResult(seed, number, objects, successes, attempts, successes, "cleared", names=names)


@pytest.mark.parametrize(
    ("script", "attempts", "successes", "end"),
    [
        ("FF", 2, 0, End.FAILURES),
        ("FSFF", 4, 1, End.FAILURES),
        ("TF", 2, 0, End.FAILURES),
        ("FSFSFSFSFS", 10, 5, End.CLEARED),
        ("SSSSS", 5, 5, End.CLEARED),
        ("SSSSK", 5, 4, End.CLEARED),
    ],
)
def test_two_failures_in_a_row_end_the_round(script: str, attempts: int, successes: int, end: End) -> None:
    tally, ended = played(5, script)
    assert (len(tally.outcomes), tally.successes, tally.cleared, ended) == (attempts, successes, successes, end)


@pytest.mark.parametrize(("word", "end"), [("n", End.NO_GRASP), ("e", End.EMPTY_VIEW)])
def test_a_round_without_a_grasp_to_try_ends_and_counts_no_attempt(word: str, end: End) -> None:
    tally, ended = played(5, "S", "g" + word)
    assert (len(tally.outcomes), tally.successes, ended) == (1, 1, end)
    assert played(5, "", word) == (Tally(), end)


def test_empty_table_is_cleared_without_an_attempt() -> None:
    assert played(0, "") == (Tally(), End.CLEARED)


def test_denominator_of_dr_is_what_lay_there_after_the_reset() -> None:
    facts = rates([row(0, 0, 3, 4, 5), row(0, 1, 1, 4, 3)])
    assert facts["gsr"] == pytest.approx(4 / 8, abs=TOLERANCE)
    assert facts["dr"] == pytest.approx(4 / 8, abs=TOLERANCE)
    assert rates([row(0, 0, 4, 4, 5)])["dr"] == pytest.approx(0.8, abs=TOLERANCE)
    assert facts["gsr_ci"][0] < 0.5 < facts["gsr_ci"][1] and facts["dr_ci"][0] < 0.5 < facts["dr_ci"][1]


def test_no_attempt_at_all_is_a_rate_of_zero() -> None:
    facts = rates([row(0, 0, 0, 0, 5)])
    assert facts["gsr"] == 0.0 and facts["dr"] == 0.0 and facts["plan_ms_median"] is None


def test_rates_of_each_seed_are_pooled_over_its_rounds() -> None:
    facts = by_seed([row(1, 0, 1, 2, 5), row(0, 0, 4, 4, 5), row(1, 1, 2, 2, 5)])
    assert facts == {"gsr_by_seed": [1.0, 0.75], "dr_by_seed": [0.8, 0.3]}


def test_same_rounds_have_no_difference_and_no_doubt_about_it() -> None:
    rows = [row(0, k, k % 3, 3, 5) for k in range(20)]
    facts = paired(rows, rows)
    assert facts["gsr"]["difference"] == 0.0 and facts["gsr"]["ci"] == [0.0, 0.0]


def test_pairing_removes_what_differs_between_rounds() -> None:
    hard = [row(0, k, 1 + k % 2, 4, 5) for k in range(40)]
    easy = [row(0, k, 2 + k % 2, 4, 5) for k in range(40)]
    facts = paired(hard, list(reversed(easy)))
    assert facts["rounds"] == 40
    assert facts["dr"]["difference"] == pytest.approx(0.2, abs=TOLERANCE)
    assert facts["dr"]["ci"] == pytest.approx([0.2, 0.2], abs=1e-9)


def test_only_common_rounds_are_paired_and_must_hold_the_same_objects() -> None:
    assert paired([row(0, 0, 1, 2, 5), row(0, 1, 0, 2, 5)], [row(0, 0, 2, 2, 5)])["rounds"] == 1
    with pytest.raises(BadInput, match="no \\(seed, round\\)"):
        paired([row(0, 0, 1, 2, 5)], [row(1, 0, 1, 2, 5)])
    with pytest.raises(BadInput, match="other objects"):
        paired([row(0, 0, 1, 2, 5, ("cup",))], [row(0, 0, 1, 2, 5, ("can",))])
