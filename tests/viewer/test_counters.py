"""Counters of the live stream are those of the log; texts are safe to put on a page."""

from evg_app.events import AttemptFinished, AttemptOutcome, Evidence, RoundStarted
from evg_app.trials.statistics import rate
from evg_app.viewer import text
from evg_app.viewer.counters import Counters


def finished(outcome: AttemptOutcome) -> AttemptFinished:
    return AttemptFinished("a", outcome, None, None, "", Evidence(), 0.0, 0.0)


def test_executed_grasps_count_and_other_passes_do_not():
    counters = Counters().after(RoundStarted(0, 0, 5))
    for outcome in (AttemptOutcome.SUCCESS, AttemptOutcome.FAILURE, AttemptOutcome.NO_GRASP):
        counters = counters.after(finished(outcome))
    assert counters == Counters(1, 2, 1, 5, 3)
    assert counters.lines() == [f"GSR {rate(1, 2)}", f"DR {rate(1, 5)}", "3 passes"]


def test_objects_that_nobody_counted_give_no_rate():
    counters = Counters().after(RoundStarted(0, 0, 5)).after(RoundStarted(0, 1, None)).after(RoundStarted(0, 2, 5))
    assert "DR objects not counted" in counters.lines()


def test_more_successes_than_objects_are_not_more_than_all():
    counters = Counters(removed=3, objects=2)
    assert f"DR {rate(2, 2)}" in counters.lines()


def test_what_devices_say_cannot_put_anything_on_the_page():
    assert "<script>" not in text.lines(["pass", "<script>alert(1)</script>"])
    assert "accepted: 3" in text.legend({"accepted": 3}) and "no candidate" in text.legend({})


def test_a_person_s_word_replaces_the_automatic_one_and_the_last_word_counts():
    lost = finished(AttemptOutcome.FAILURE)
    counters = Counters().after(RoundStarted(0, 0, 5)).after(lost)
    assert counters.labelled(lost, True).lines()[0] == f"GSR {rate(1, 1)}"
    assert counters.labelled(lost, True).labelled(lost, True).successes == 1
    assert counters.labelled(lost, True).labelled(lost, None).lines() == counters.lines()
