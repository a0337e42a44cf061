"""The paper's real-robot table, entered again: its intervals, and the cells that do not add up."""

from pathlib import Path

import pytest

from evg_app.errors import BadInput
from evg_app.trials.published import Cell, fitting, follows, read_table
from evg_app.trials.statistics import wilson

TABLE = Path(__file__).parents[2] / "docs" / "results" / "paper_real_robot.csv"


def test_the_paper_s_table_has_three_percentages_that_do_not_follow_from_their_counts():
    cells = read_table(TABLE)
    assert len(cells) == 21
    wrong = {(c.method, c.scene): c.problems() for c in cells if c.problems()}
    assert set(wrong) == {("GIGA", "adv"), ("IGD", "pile"), ("EquiGIGA", "adv")}
    assert "66/99 = 66.67 %" in wrong["GIGA", "adv"][0] and "72.5 % would be 66/91" in wrong["GIGA", "adv"][0]
    assert "51/88 = 57.95 %" in wrong["IGD", "pile"][0] and "63.0 % would be 51/81" in wrong["IGD", "pile"][0]


def test_the_interval_of_a_cell_is_known():
    best = next(c for c in read_table(TABLE) if (c.method, c.scene) == ("EquiIGD", "packed"))
    low, high = wilson(best.successes, best.attempts)
    assert "71/79 = 89.9 % [81.3, 94.8]" in best.line() and low == pytest.approx(0.813, abs=5e-4)
    assert best.facts()["gsr_ci"] == [low, high]


def test_a_percentage_follows_when_it_rounds_to_its_own_decimals():
    assert follows(57, 80, "71.3") and follows(57, 80, "71.2") and not follows(57, 80, "71.4")
    assert follows(2, 3, "67") and follows(2, 3, "66.7") and not follows(2, 3, "66")


def test_counts_that_would_fit_are_offered_nearest_first():
    assert fitting(51, 88, "63.0")[0] == (51, 81)
    assert fitting(1, 2, "99.99") == []


def test_a_declutter_rate_that_does_not_follow_is_told():
    assert "DR is printed as 90.0 %" in Cell("m", "s", 3, 4, "75.0", "90.0", 4).problems()[0]
    assert Cell("m", "s", 3, 4, "75.0", "75.0", 4).problems() == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("method,scene\n", "successes, attempts, gsr_percent is missing"),
        ("method,scene,successes,attempts,gsr_percent\na,b,5,4,100\n", ":2: 5 successes in 4 attempts"),
        ("method,scene,successes,attempts,gsr_percent\na,b,x,4,100\n", ":2:"),
        ("method,scene,successes,attempts,gsr_percent\na,b,1,4,often\n", ":2:"),
    ],
)
def test_a_table_that_cannot_be_used_names_the_line(tmp_path, text, said):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(BadInput, match=said):
        read_table(tmp_path / "t.csv")
    with pytest.raises(BadInput, match="cannot be read"):
        read_table(tmp_path / "none.csv")
