"""A dry run looks, plans, judges and checks, and sends nothing at all."""

from picking_fakes import Lab

from evg_app.errors import DeviceTimeout, Refused
from evg_app.events import AttemptFinished, Judged, MotionStarted, RoundFinished, RunFinished, Warned
from evg_app.picking.dry import dry_run


def run(lab: Lab, check=lambda name, trajectory: None, count: int = 1):
    return dry_run(lab.context(), lab, (0,), count, check)


def test_nothing_is_moved_and_nothing_counts():
    lab = Lab()
    result = run(lab, count=2)
    assert result.exit_code == 0 and result.error is None
    assert lab.of(MotionStarted) == [] and lab.gripper.commands == []
    assert [f.outcome for f in lab.of(AttemptFinished)] == ["abandoned"] * 2
    assert [r.detail for r in lab.of(RoundFinished)] == ["dry run"] * 2
    assert "nothing was moved" in lab.of(RunFinished)[0].detail


def test_every_motion_of_the_pick_is_checked_and_said():
    lab, checked = Lab(), []
    run(lab, lambda name, trajectory: checked.append(name))
    assert lab.of(Judged)[0].chosen is not None
    assert checked == ["reach", "approach", "lift", "transport", "back", "retreat"]
    said = [w.text for w in lab.of(Warned) if w.cause == "dry run"]
    assert len(said) == 6 and all("would be sent" in text for text in said)


def test_a_motion_that_would_be_refused_is_said_and_does_not_end_the_run():
    lab = Lab()

    def check(name, trajectory):
        if name == "lift":
            raise Refused("'lift' would leave the box")

    assert run(lab, check).exit_code == 0
    assert any("leave the box" in w.text for w in lab.of(Warned))


def test_a_camera_that_fails_ends_the_dry_run_as_hardware():
    lab = Lab()

    def fail(_frame):
        raise DeviceTimeout("a depth frame", 5.0)

    lab.camera.spoil = fail
    result = run(lab)
    assert result.exit_code == 4 and lab.of(MotionStarted) == []


def test_a_stop_ends_it():
    lab = Lab()
    lab.stop.request()
    lab.stop.request()
    assert run(lab).exit_code == 130
