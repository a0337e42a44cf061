"""Every pass without a success has one place in the tree of reasons."""

import pytest

from evg_app.events import AttemptOutcome
from evg_app.trials.reasons import BRANCHES, reason, tree, tree_lines
from evg_app.types import Verdict


def test_a_success_has_no_reason():
    assert reason("success", "", {}) is None


@pytest.mark.parametrize("outcome", [o for o in AttemptOutcome if o is not AttemptOutcome.SUCCESS])
def test_every_outcome_has_a_branch(outcome):
    branch, leaf = reason(str(outcome), "", {})
    assert branch in BRANCHES and leaf


@pytest.mark.parametrize("verdict", [v for v in Verdict if v not in (Verdict.ACCEPTED, Verdict.NOT_EXAMINED)])
def test_without_a_feasible_grasp_most_refusals_decide(verdict):
    branch, leaf = reason("no feasible grasp", "", {str(verdict): 5, "not examined": 90})
    assert branch in ("planning", "reach", "collision", "user") and str(verdict) in leaf


@pytest.mark.parametrize(
    ("failure", "branch"),
    [
        ("contact on approach", "collision"),
        ("nothing held after lift", "slip"),
        ("lost in transit", "drop"),
        ("not in the bin", "drop"),
        ("device error", "hardware"),
        ("motion aborted", "hardware"),
        ("something new", "other"),
    ],
)
def test_the_loop_s_words_for_failures_are_known(failure, branch):
    assert reason("failure", failure, {}) == (branch, failure)


def test_the_words_that_the_loop_writes_are_all_in_the_tree():
    """Read from the loop's own source, so that a new word cannot be forgotten here."""
    import inspect
    import re

    from evg_app.picking import score

    words = set(re.findall(r'(?:return|if|else) "([a-z ]+)"', inspect.getsource(score._failure)))
    assert len(words) >= 6
    assert all(reason("failure", word, {})[0] != "other" for word in words), words


def test_the_tree_adds_up():
    found = tree([("slip", "nothing held after lift")] * 3 + [("reach", "ik"), None, ("slip", "x")])
    assert list(found) == ["reach", "slip"] and found["slip"] == {
        "n": 4,
        "leaves": {"nothing held after lift": 3, "x": 1},
    }
    assert tree_lines(found)[1].strip() == "1  ik" and tree_lines({}) == ["none"]
