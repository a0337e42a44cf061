"""The judgement of a grasp from several signs."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from picking_fakes import OBJECT_WIDTH, Lab

from evg_app.config.evidence import EvidenceModel
from evg_app.config.models import GripperModel
from evg_app.errors import HardwareError
from evg_app.events import AttemptFinished, AttemptOutcome, Warned
from evg_app.perception.change import SceneChange
from evg_app.picking.evidence import Signs, judge

GRIPPER, RULE = GripperModel(), EvidenceModel()
HELD, CLOSED, OPEN = 0.03, 0.001, 0.0795
GONE, STAYED = 5e-4, 0.0


def signs(lifted=HELD, release=HELD, device=True, area=GONE, compared=1.0, closed=HELD, emptied=None) -> Signs:
    return Signs(closed, lifted, release, device, area, compared, emptied)


@pytest.mark.parametrize(
    ("seen", "why"),
    [
        (signs(), ""),
        (signs(lifted=CLOSED), "nothing held after lift"),
        (signs(lifted=OPEN), "nothing held after lift"),
        (signs(release=CLOSED), "lost in transit"),
        (signs(release=None), "lost in transit"),
        (signs(lifted=0.052, release=0.019), ""),
        (signs(emptied=0.0), ""),
        (signs(emptied=HELD), "still in the hand"),
        (signs(area=STAYED), "object still in its place"),
        (signs(area=STAYED, compared=0.1), ""),
        (signs(area=None, compared=None), ""),
        (Signs(), "never lifted"),
    ],
)
def test_rule(seen: Signs, why: str):
    verdict = judge(seen, GRIPPER, RULE)
    assert (verdict.held, verdict.why) == (not why, why)


@given(
    st.sampled_from([CLOSED, HELD, OPEN]),
    st.sampled_from([CLOSED, HELD, OPEN]),
    st.sampled_from([None, STAYED, GONE]),
)
def test_device_word_never_decides_but_a_disagreement_is_said(lifted: float, release: float, area: float | None):
    told = {device: judge(signs(lifted, release, device, area), GRIPPER, RULE) for device in (True, False, None)}
    assert len({(verdict.held, verdict.why) for verdict in told.values()}) == 1
    liar = told[lifted != HELD]
    assert any("the device says" in words for words in liar.disagreeing)
    assert not any("the device says" in words for words in told[None].disagreeing)


def test_object_that_stays_in_its_place_is_no_success_whatever_the_fingers_say():
    lab = Lab(objects=1, has_referee=False)
    lab.perception.change = lambda *args: SceneChange(0.0, 1.0)
    lab.run()
    first = lab.of(AttemptFinished)[0]
    assert first.outcome is AttemptOutcome.FAILURE and first.failure == "object still in its place"
    assert first.evidence.place_area == 0.0 and first.evidence.place_compared == 1.0
    assert first.evidence.width_lifted == pytest.approx(OBJECT_WIDTH)
    assert any(e.cause == "signs disagree" for e in lab.of(Warned))


def test_every_sign_is_in_the_log_of_a_success():
    lab = Lab(objects=1, has_referee=False)
    lab.run()
    first = lab.of(AttemptFinished)[0]
    assert first.outcome is AttemptOutcome.SUCCESS
    seen = first.evidence
    assert None not in (seen.width_closed, seen.width_lifted, seen.width_release, seen.is_grasped_lifted)
    assert None not in (seen.gripper_success, seen.place_area, seen.place_compared, seen.width_emptied)


def test_what_clings_to_a_finger_above_the_bin_is_no_success_and_is_opened_for_twice():
    lab = Lab(script="CF", objects=1, has_referee=False)
    lab.run()
    first = lab.of(AttemptFinished)[0]
    assert first.outcome is AttemptOutcome.FAILURE and first.failure == "still in the hand"
    assert first.evidence.width_emptied == pytest.approx(OBJECT_WIDTH)
    assert lab.gripper.commands[:5] == ["grasp", "move", "grasp", "move", "grasp"]
    assert sum(e.cause == "still in the hand" for e in lab.of(Warned)) == 2


def test_fingers_that_still_close_above_the_bin_are_waited_for():
    lab = Lab(script="SS", objects=1)
    state, seen = lab.gripper.state, []

    def closing():
        if lab.motion == "drop" and not seen.count("end"):
            lab.gripper.width = max(0.0, lab.gripper.width - 0.01)
            seen.append("end" if lab.gripper.width == 0.0 else "moving")
        return state()

    lab.gripper.state = closing
    lab.run()
    first = lab.of(AttemptFinished)[0]
    assert first.evidence.width_release == 0.0 and first.verified is False and first.failure == "lost in transit"


def test_with_a_referee_the_hand_is_not_closed_again():
    lab = Lab(script="LS", objects=1)
    lab.run()
    first = lab.of(AttemptFinished)[0]
    assert first.evidence.width_emptied is None and first.evidence.place_area is None
    assert first.verified is False and first.failure == "lost in transit"
    assert lab.gripper.commands == ["grasp", "move", "grasp", "move"]


def test_camera_that_fails_after_the_pick_costs_the_sign_not_the_round():
    lab = Lab(objects=1, has_referee=False)
    capture = lab.camera.capture

    def failing(*, after: float, timeout: float):
        if lab.on_table() == 0 and not lab.of(AttemptFinished):
            raise HardwareError("the cable is out")
        return capture(after=after, timeout=timeout)

    lab.camera.capture = failing
    lab.run()
    assert lab.of(AttemptFinished)[0].outcome is AttemptOutcome.SUCCESS
    assert any(e.cause == "no look after the pick" for e in lab.of(Warned))
    assert lab.reasons == ["cleared"]
