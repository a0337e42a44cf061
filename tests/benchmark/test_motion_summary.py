"""The accounts of the motion benchmark: rows in, the JSON's numbers out."""

import pytest

from evg_app.benchmark.motion.row import BASELINE, TRUE, Cycle, SceneRow, Target
from evg_app.benchmark.motion.summary import summary
from evg_app.errors import BadInput

POLICIES = ("optimistic", "conservative")
RATIOS = {"position": 0.5, "velocity": 0.9, "acceleration": 0.8, "jerk": 0.99, "join": 0.0}
CHANGED = 4e-4
KEYS = [
    *("reachable_found", "reachable_total", "check_ms_median", "scene_ms_median", "path_ms_median", "path_ms_p99"),
    *("executed", "contacts", "executed_observed", "contacts_observed", "limit_violations"),
]
"""As the issue names them."""


def cycle(arm: str, contacts: tuple[str, ...] = (), broken: tuple[str, ...] = (), **more) -> Cycle:
    return Cycle(arm, 0, "done", contacts=contacts, broken=broken, ratios=RATIOS, **more)


def row(number: int, cycles: tuple[Cycle, ...], targets: tuple[Target, ...] = ()) -> SceneRow:
    times = ((20.0,), (1.0, 3.0), (9.0,), (100.0, 900.0), (4.0,))
    return SceneRow(0, number, "packed", ("mug_01",), 9, targets, cycles, *times, "c0ffee")


ROWS = [
    row(
        0,
        (
            cycle(TRUE),
            cycle(BASELINE, ("reach: panda_hand - 1:mug_01 (2.10 mm)", "reach: panda_link6 - table (0.10 mm)")),
            cycle("observed optimistic", ("approach: panda_hand - 1:mug_01 (0.10 mm)",), still=0.0, moved=3e-3),
            Cycle("observed conservative", 0, "no pick: gripper-scene collision 3, ik 1"),
        ),
        (Target(0, True, True, True, True, "accepted"), Target(0, True, True, True, False, "no path")),
    ),
    row(
        1,
        (
            cycle(TRUE, broken=("jerk",)),
            cycle(BASELINE, broken=("jerk",)),
            cycle("observed optimistic", still=5e-4, moved=0.0),
            cycle("observed conservative"),
        ),
        (Target(0, True, True, False, False, "ik"), Target(0, True, False, False, False, "joint limit")),
    ),
]


def test_the_keys_are_the_issue_s_and_count_picks_not_contacts() -> None:
    facts = summary(ROWS, "optimistic", POLICIES, CHANGED)
    assert all(isinstance(facts[key], int | float) for key in KEYS)
    assert (facts["executed"], facts["contacts"]) == (2, 0)
    assert (facts["executed_observed"], facts["contacts_observed"]) == (2, 1)
    baseline = facts["arms"][BASELINE]
    assert (baseline["executed"], baseline["contacts"]) == (2, 1)
    assert baseline["touched"] == {"reach: panda_hand - mug_01": 1, "reach: panda_link6 - table": 1}


def test_the_bare_observed_keys_follow_the_configured_policy() -> None:
    facts = summary(ROWS, "conservative", POLICIES, CHANGED)
    assert (facts["executed_observed"], facts["contacts_observed"]) == (1, 0)
    assert facts["arms"]["observed conservative"]["no_pick"] == {"gripper-scene collision, ik": 1}


def test_reachability_compares_like_with_like() -> None:
    facts = summary(ROWS, "optimistic", POLICIES, CHANGED)
    assert (facts["reachable_found"], facts["reachable_picked"], facts["reachable_total"]) == (2, 1, 3)
    assert facts["reachable_not_picked"] == {"ik": 1, "no path": 1}


def test_limit_violations_are_the_planner_s_not_the_baseline_s() -> None:
    facts = summary(ROWS, "optimistic", POLICIES, CHANGED)
    assert facts["limit_violations"] == 1 and facts["arms"][BASELINE]["limit_violations"] == 1


def test_the_look_before_the_approach_is_counted() -> None:
    looked = summary(ROWS, "optimistic", POLICIES, CHANGED)["recheck"]
    assert (looked["looks"], looked["false_alarms"], looked["noticed"]) == (2, 1, 1)


def test_rows_survive_json_and_anything_else_is_refused() -> None:
    assert SceneRow.from_dict(ROWS[0].to_dict()) == ROWS[0]
    with pytest.raises(BadInput, match="delete the file"):
        SceneRow.from_dict({"seed": 0})


def test_without_scenes_there_are_no_times() -> None:
    facts = summary([], "optimistic", POLICIES, CHANGED)
    assert facts["check_ms_median"] is None and facts["executed"] == 0
