"""A protocol on a real table: the operator is told what to place, asked what happened, and both labels are kept."""

from dataclasses import replace

import numpy as np
import pytest
from picking_fakes import Lab

from evg_app.config.files import shipped_folder
from evg_app.config.protocol import ProtocolConfig, load_protocol
from evg_app.errors import BadInput
from evg_app.events import AttemptFinished, RoundFinished
from evg_app.picking.run import run_rounds
from evg_app.trials.protocol import plan_round
from evg_app.trials.recorder import Recorder
from evg_app.trials.report import report
from evg_app.trials.resume import finished_rounds, require_same
from evg_app.trials.rows import read_rows
from evg_app.trials.scorekeeper import Scorekeeper
from evg_app.trials.summary import summary

NAMES = sorted(path.stem for path in (shipped_folder() / "sim" / "protocols").glob("*.yaml"))
FAKE = ProtocolConfig(
    name="fake-3x2",
    description="two objects, three rounds",
    source="nowhere",
    scene="packed",
    rounds=3,
    objects_per_round=2,
    objects=("cup", "can", "box", "jar"),
    placement=("Clear the table.",),
)


class Table(Lab):
    """A lab whose table is set and judged by an operator with scripted answers."""

    def operated(self, folder, answers, resume=False, protocol=FAKE, stop_after=None):
        told, answers = [], iter(answers)

        def ask(question):
            told.append(question)
            if "ready" in question:
                self.prepare(0, 0)
                return ""
            return next(answers)

        config = {"protocol": protocol.model_dump(mode="json")}

        def place(seed, index):
            return plan_round(protocol, index, seed).facts()

        done = finished_rounds(folder) if resume else frozenset()
        with Recorder(folder, config, {}, resume=resume, placement=place) as recorder:
            keeper = Scorekeeper(protocol, ask, told.append, recorder.store.label)
            self.listeners[:] = [recorder, keeper]
            if stop_after is not None:
                self.listeners.append(lambda e: self.stop.request_soft() if stop_after(e) else None)
            ctx = self.context()
            result = run_rounds(replace(ctx, referee=keeper), keeper, (protocol.seed,), protocol.rounds, done)
        return result, told


def table(script="S" * 60):
    return Table(script=script, objects=FAKE.objects_per_round)


@pytest.mark.parametrize("name", NAMES)
def test_shipped_protocols_are_15_rounds_of_5_as_the_paper_s(name):
    protocol = load_protocol(name)
    assert (protocol.rounds, protocol.objects_per_round) == (15, 5) and name == protocol.name
    assert len(protocol.objects) >= 10


def test_the_three_scenes_of_the_paper_are_shipped():
    assert NAMES == ["adversarial-15x5", "packed-15x5", "pile-15x5"]


def test_a_round_s_plan_depends_on_nothing_but_protocol_and_round():
    plans = [plan_round(FAKE, i) for i in range(40)]
    assert plans[7] == plan_round(FAKE, 7)
    assert len({plan.objects for plan in plans}) > 6, "orders are random"
    for plan in plans:
        assert len(set(plan.objects)) == 2 and set(plan.objects) <= set(FAKE.objects)
        assert all(turn % 15 == 0 and 0 <= turn < 360 for turn in plan.turns_deg)
    seen = np.array([[name in plan.objects for name in FAKE.objects] for plan in plans]).mean(axis=0)
    assert (abs(seen - 0.5) < 0.3).all(), "no object is preferred"


def test_the_operator_is_told_what_to_place_and_asked_after_every_attempt(tmp_path):
    result, told = table().operated(tmp_path / "run", ["y"] * 6)
    assert result.exit_code == 0 and len(result.rounds) == 3
    assert "fake-3x2: round 1 of 3" in told and any("Clear the table" in line for line in told)
    assert sum("in the bin" in line for line in told) == 6
    rows = read_rows(tmp_path / "run")
    assert rows.runs[0]["protocol"] == "fake-3x2"
    assert '"objects"' in rows.rounds[0]["placement"]
    facts = summary(tmp_path / "run")
    assert (facts["gsr"], facts["dr"]) == (1.0, 1.0) and facts["operator"]["agree"] == 6


def test_both_labels_are_kept_and_their_disagreement_is_reported(tmp_path):
    """The gripper held something in every attempt but the second; the operator saw it otherwise twice."""
    lab = table(script="SFSSSS")
    lab.operated(tmp_path / "run", ["y", "y", "n", "y", "?", "y"])
    facts = summary(tmp_path / "run")
    operator = facts["operator"]
    assert operator["labelled"] == facts["attempts"] and operator["cannot_tell"] == 1
    assert operator["only_operator_success"] == 1 and operator["only_automatic_success"] == 1
    assert len(operator["disagreeing_attempts"]) == 2
    assert facts["successes"] == facts["attempts"] - 1, "the operator's word counts, the gripper's where there is none"
    text = report(facts)
    assert "operator labelled" in text and "GSR of the automatic label" in text


def test_the_loop_goes_by_the_operator_s_word(tmp_path):
    """Two failures in a row by the operator end a round although the gripper felt something."""
    lab = table()
    lab.operated(tmp_path / "run", ["n"] * 6)
    assert [str(e.stop_reason) for e in lab.of(RoundFinished)] == ["two consecutive failures"] * 3


def test_a_word_that_is_no_answer_is_asked_again(tmp_path):
    _, told = table().operated(tmp_path / "run", ["maybe", "y", "yes", "Y", "n", "y", "y", "y"])
    assert "please type y, n or ?" in told


def test_an_interrupted_protocol_goes_on_where_it_was_and_counts_each_round_once(tmp_path):
    folder, lab = tmp_path / "run", table()
    first, _ = lab.operated(
        folder,
        ["y"] * 9,
        stop_after=lambda e: isinstance(e, AttemptFinished) and e.attempt_id.startswith("s0-r001-a00"),
    )
    assert first.stopped and finished_rounds(folder) == {(0, 0)}
    assert summary(folder)["attempts"] == 3
    second, told = table().operated(folder, ["y"] * 9, resume=True)
    assert second.exit_code == 0 and [r.index for r in second.rounds] == [1, 2]
    assert "fake-3x2: round 2 of 3" in told and "fake-3x2: round 1 of 3" not in told
    facts = summary(folder)
    assert (facts["rounds"], facts["attempts"], facts["successes"], facts["objects"]) == (3, 6, 6, 6)
    assert (facts["rounds_begun_again"], facts["sessions"], facts["status"]) == (1, 2, "finished")
    assert "1 interrupted rounds were begun again" in report(facts)
    assert finished_rounds(folder) == {(0, 0), (0, 1), (0, 2)}


def test_going_on_with_another_setting_is_refused_and_says_which(tmp_path):
    folder = tmp_path / "run"
    table().operated(folder, ["y"] * 6)
    same = {"protocol": FAKE.model_dump(mode="json")}
    require_same(folder, same | {"arguments": {"speed": 3}}, "fake", "0" * 64)
    other = {"protocol": same["protocol"] | {"seed": 9}}
    with pytest.raises(BadInput, match=r"protocol\.seed"):
        require_same(folder, other, "fake", "0" * 64)
    with pytest.raises(BadInput, match="weights"):
        require_same(folder, same, "fake", "1" * 64)
    with pytest.raises(BadInput, match="model"):
        require_same(folder, same, "vgn", "0" * 64)


def test_without_an_answer_wanted_the_gripper_decides(tmp_path):
    silent = FAKE.model_copy(update={"label": "never"})
    _, told = table().operated(tmp_path / "run", [], protocol=silent)
    assert not any("in the bin" in line for line in told)
    assert summary(tmp_path / "run")["operator"]["cannot_tell"] == 6


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"objects": ("cup",)}, "1 names for rounds of 2"),
        ({"objects": ("cup", "cup")}, "twice"),
        ({"placement": ()}, "at least 1 item"),
    ],
)
def test_a_protocol_that_cannot_be_followed_is_refused(change, said):
    with pytest.raises(ValueError, match=said):
        ProtocolConfig.model_validate(FAKE.model_dump() | change)
