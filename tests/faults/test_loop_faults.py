"""Faults injected into the loop (anchors E): each is named, bounded, counted, and leaves the devices stopped."""

import numpy as np
import pytest
from picking_fakes import DROP, LOOK, OBJECT_WIDTH, Lab, once, pose, reflex, refuse

from evg_app.errors import DeviceTimeout, Stopped
from evg_app.events import AttemptFinished, RoundFinished, RunFinished, SceneRechecked, StateEntered
from evg_app.picking.context import Settings
from evg_app.picking.states import State
from evg_app.types import Grasps, MotionResult

MOVING = ["reach", "approach", "lift", "drop", "return"]
"""Names of the motions of one pass."""


def _timeout(_frame):
    raise DeviceTimeout("a depth frame", 5.0)


def test_a_camera_that_never_answers_ends_the_round_with_error_and_exit_code_4():
    lab = Lab()
    lab.camera.spoil = _timeout
    result = lab.run(rounds=3)
    assert lab.reasons == ["error"] and result.exit_code == 4
    assert "depth frame" in lab.of(RoundFinished)[0].detail
    assert lab.outcomes == ["error"] and lab.gripper.stops == 1


def test_one_lost_frame_is_only_a_warning():
    lab = Lab(objects=1)
    first = once(lambda: _timeout(None))
    lab.camera.spoil = lambda frame: first() or frame
    assert lab.run().exit_code == 0
    assert lab.warnings == ["camera timeout"]


def test_an_image_without_depth_is_refused_with_its_reason():
    lab = Lab()
    lab.camera.spoil = lambda frame: frame.__class__(np.zeros_like(frame.depth), 0.001, frame.intrinsics, 1.0, "cam")
    lab.run()
    assert lab.reasons == ["error"]
    assert "holds no depth" in lab.of(RoundFinished)[0].detail


def test_a_camera_that_repeats_an_old_frame_is_noticed():
    lab, old = Lab(), []
    lab.camera.spoil = lambda frame: old[0] if old else (old.append(frame) or frame)
    lab.run()
    assert lab.reasons == ["error"] and "old frame" in lab.of(RoundFinished)[0].detail
    assert lab.states[4:6] == ["reach", "recheck"], "the second look at the scene already notices"


MOVED, NOISE = 30e-4, 1e-4
"""Changed area near the grasp when an object moved, and from noise alone [m^2]."""


def test_an_object_moved_between_planning_and_approach_is_planned_on_again():
    lab = Lab(objects=1, moved=[MOVED, MOVED])
    result = lab.run()
    assert lab.outcomes == ["replanned", "replanned", "success"] and lab.warnings == ["scene changed"] * 2
    assert lab.states[4:9] == ["reach", "recheck", "retreat", "score", "look"]
    assert (result.rounds[0].attempts, result.rounds[0].successes) == (1, 1), "a replanned pass executed no grasp"
    assert [e.changed for e in lab.of(SceneRechecked)] == [True, True, False]
    assert len(lab.motion_planner.seen) == 3 and lab.gripper.commands.count("grasp") == 1


def test_noise_alone_is_no_reason_to_plan_again():
    lab = Lab(objects=1, moved=[NOISE])
    assert lab.run().rounds[0].successes == 1 and lab.outcomes == ["success"]


def test_a_scene_that_never_stops_moving_ends_the_round_by_name():
    lab = Lab(objects=1, moved=[MOVED] * 100)
    lab.run()
    assert lab.reasons == ["attempt limit"] and set(lab.outcomes) == {"replanned"}


def test_the_look_before_the_approach_can_be_switched_off():
    lab = Lab(objects=1, moved=[MOVED], recheck=False)
    assert lab.run().rounds[0].successes == 1 and not lab.of(SceneRechecked)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 2.0])
def test_broken_grasps_are_never_judged(bad):
    lab = Lab()
    grasps = lab.planner.plan(None)
    T = grasps.T_task_grasp.copy()
    T[:, :3, :3] = bad
    lab.planner.grasps = Grasps(T, grasps.width, grasps.score)
    lab.run()
    assert lab.reasons == ["no grasp"] and lab.warnings == ["broken grasps"]
    assert not lab.motion_planner.seen


def test_contact_on_the_approach_can_be_made_a_failure():
    lab = Lab(script="S", objects=1, settings=Settings(close_after_contact=False))

    def touch(handle):
        lab.arm.wrench = np.array([0.0, 0.0, 60.0 if handle.t > 0.1 else 0.0, 0.0, 0.0, 0.0])

    lab.arm.during["approach"] = touch
    lab.arm.during["back out"] = lambda handle: setattr(lab.arm, "wrench", np.zeros(6))
    lab.run()
    assert lab.reasons == ["two consecutive failures"]
    assert [f.failure for f in lab.of(AttemptFinished)] == ["contact on approach"] * 2
    assert lab.arm.cancels == 2 and "grasp" not in lab.gripper.commands
    assert np.allclose(lab.arm.q, pose(LOOK), atol=0.05)


def test_the_gripper_closes_where_contact_stopped_the_approach():
    lab = Lab(script="SS", objects=1)

    def touch(handle):
        lab.arm.wrench = np.array([0.0, 0.0, 60.0 if handle.t > 0.1 else 0.0, 0.0, 0.0, 0.0])

    lab.arm.during["approach"] = touch
    assert lab.run().rounds[0].successes == 1
    assert lab.of(AttemptFinished)[0].evidence.contact is True and lab.arm.cancels == 1
    assert lab.states[6:9] == ["approach", "close", "lift"]


def test_a_steady_wrench_from_payload_is_not_contact():
    lab = Lab(objects=1)
    lab.arm.wrench = np.array([0.0, 0.0, 60.0, 0.0, 0.0, 0.0])
    assert lab.run().rounds[0].successes == 1


def test_a_motion_aborted_mid_approach_backs_out_and_counts():
    lab = Lab(script="FF")
    aborted = []

    def abort(handle):
        if not aborted and handle.t > 0.1:
            aborted.append(1)
            return MotionResult(False, "GOAL_TOLERANCE_VIOLATED", 0.3)
        return None

    lab.arm.during["approach"] = abort
    lab.run()
    assert lab.of(AttemptFinished)[0].failure == "motion aborted"
    assert lab.states[6:9] == ["approach", "retreat", "score"]


@pytest.mark.parametrize("name", MOVING)
def test_a_reflex_is_recovered_and_the_attempt_is_a_failure(name):
    lab = Lab(script="SSSSSS", objects=2)
    lab.arm.during[name] = reflex(lab.arm)
    result = lab.run()
    assert lab.arm.recoveries == 1 and result.exit_code == 0
    assert lab.outcomes[0] == "failure" and lab.of(AttemptFinished)[0].failure == "device error"
    assert lab.reasons == ["cleared"] and "recovered" in lab.warnings


@pytest.mark.parametrize("name", ["lift", "drop"])
def test_after_a_reflex_a_held_object_still_goes_to_the_bin(name):
    lab = Lab(objects=1)
    lab.arm.during[name] = reflex(lab.arm)
    lab.run()
    assert lab.binned == 1 and lab.reasons == ["cleared"]


def test_an_object_that_blocks_the_arm_twice_is_let_go_and_the_round_goes_on():
    lab = Lab(script="SSSS", objects=2)
    blocks = [reflex(lab.arm), reflex(lab.arm)]

    def jammed(handle):
        ended = blocks[0](handle) if blocks else None
        if ended is not None:
            blocks.pop(0)
        return ended

    lab.arm.during["drop"] = jammed
    result = lab.run()
    assert lab.outcomes[0] == "failure" and "letting go" in lab.warnings
    assert result.exit_code == 0 and lab.reasons == ["cleared"] and result.rounds[0].successes == 2


@pytest.mark.parametrize("name", ["look", *MOVING])
def test_a_refused_recovery_ends_the_run_with_error(name):
    lab = Lab()
    lab.arm.during[name] = reflex(lab.arm)
    lab.arm.recover_fails = 99
    result = lab.run(rounds=3)
    assert result.exit_code == 4 and lab.reasons == ["error"]
    assert lab.arm.recoveries == lab.settings.recover_tries
    assert "recovery failed" in lab.of(RunFinished)[0].detail and lab.gripper.stops == 1


def test_a_late_recovery_is_tried_again():
    lab = Lab(objects=1)
    lab.arm.during["reach"] = reflex(lab.arm)
    lab.arm.recover_fails = 1
    assert lab.run().exit_code == 0 and lab.arm.recoveries == 2


def test_a_reflex_that_comes_back_for_ever_ends_the_run():
    lab = Lab()

    def always(handle):
        return reflex(lab.arm)(handle)

    lab.arm.during["look"] = lab.arm.during["retreat"] = always
    result = lab.run()
    assert result.exit_code == 4 and "in a row did not help" in lab.of(RoundFinished)[0].detail
    assert lab.arm.recoveries == lab.settings.max_recoveries


def test_a_motion_that_never_ends_times_out_by_name_and_is_cancelled():
    lab = Lab()

    def stuck(handle):
        handle.t = 0.0

    lab.arm.during["approach"] = stuck
    lab.run()
    first = lab.of(AttemptFinished)[0]
    assert first.failure == "device error" and lab.arm.cancels >= 1
    assert any("the motion 'approach'" in getattr(e, "text", "") for e in lab.events)


def test_the_gripper_lies_success_but_holds_nothing():
    lab = Lab(script="FF")
    lab.gripper.lie = True
    lab.run()
    first = lab.of(AttemptFinished)[0]
    assert (first.outcome, first.verified) == ("failure", False)
    assert first.evidence.gripper_success is True and first.evidence.is_grasped_lifted is True


def test_the_gripper_lies_failure_but_holds_something():
    lab = Lab(script="S", objects=1)
    lab.gripper.lie = False
    lab.run()
    first = lab.of(AttemptFinished)[0]
    assert (first.outcome, first.verified) == ("success", True) and first.evidence.gripper_success is False
    assert first.evidence.width_lifted == OBJECT_WIDTH


def test_an_object_lost_in_transit_is_seen_before_the_release():
    lab = Lab(script="LL", objects=3)
    lab.run()
    first = lab.of(AttemptFinished)[0]
    assert (first.verified, first.truth, first.failure) == (False, False, "lost in transit")


def test_a_gripper_that_does_not_answer_is_a_device_error():
    lab = Lab(script="SSSS", objects=2)
    lab.gripper.during = lambda name: once(refuse)() if name == "grasp" else None
    lab.run()
    assert lab.outcomes == ["failure", "failure"] and lab.reasons == ["two consecutive failures"]


def test_no_way_back_at_all_is_an_error_and_not_an_endless_loop():
    lab = Lab()
    lab.motion_planner.routes_fail = 10_000
    result = lab.run()
    assert result.exit_code == 4 and "no collision-free way" in lab.of(RoundFinished)[0].detail


@pytest.mark.parametrize("jump", [3600.0, -3600.0])
@pytest.mark.parametrize("name", ["reach", "lift"])
def test_a_clock_jump_in_a_motion_neither_fails_nor_hangs_it(name, jump):
    lab = Lab(objects=1)
    lab.arm.during[name] = once(lambda: setattr(lab.clock, "jump", jump))
    assert lab.run().rounds[0].successes == 1
    assert lab.of(AttemptFinished)[0].motion_s < 60.0


@pytest.mark.parametrize("state", [s for s in State if s not in (State.RETREAT, State.RECOVER, State.CONFIRM)])
def test_one_stop_request_in_any_state_ends_safely_at_the_look_pose(state):
    lab = Lab(script="SSSSSS", objects=3)
    ask = once(lab.stop.request)
    lab.listeners.append(lambda e: ask() if isinstance(e, StateEntered) and e.state == state else None)
    result = lab.run(rounds=3)
    assert result.exit_code == 130 and lab.reasons == ["stopped by the user"]
    assert np.allclose(lab.arm.q, pose(LOOK), atol=0.05) and lab.arm.cancels == 0
    held_on = state in (State.CLOSE, State.LIFT, State.VERIFY, State.DROP, State.RELEASE, State.RETURN, State.SCORE)
    assert lab.binned == (1 if held_on else 0), "what was held must have gone to the bin"
    assert lab.outcomes == (["success"] if held_on else ["abandoned"])
    assert lab.of(RunFinished)[0].status == "stopped by the user"


@pytest.mark.parametrize("name", ["look", "reach", "approach", "lift", "drop"])
def test_two_stop_requests_cancel_the_motion_at_once(name):
    lab = Lab()

    def ask(_handle):
        lab.stop.request()
        lab.stop.request()

    lab.arm.during[name] = once(lambda: ask(None))
    start = lab.clock.t
    result = lab.run(rounds=3)
    assert result.exit_code == 130 and lab.arm.cancels == 1 and lab.gripper.stops == 1
    assert lab.states[-1] == name and lab.clock.t - start < 5.0
    assert lab.outcomes == ["abandoned"] and lab.reasons == ["stopped by the user"]
    if name == "drop":
        assert lab.gripper.width == OBJECT_WIDTH and not np.allclose(lab.arm.q, pose(DROP))


def test_a_full_disk_ends_the_run_safely_with_what_is_held_in_the_bin():
    lab = Lab(script="SSS", objects=3)

    def full(event):
        if isinstance(event, StateEntered) and event.state == "lift":
            raise OSError(28, "No space left on device")

    lab.listeners.append(full)
    result = lab.run(rounds=2)
    assert result.exit_code == 4 and "No space left" in str(result.error)
    assert lab.binned == 1 and np.allclose(lab.arm.q, pose(LOOK), atol=0.05)
    assert result.rounds[-1].stop_reason == "error" and "log failed" in result.rounds[-1].detail


def test_a_bug_in_the_planner_stops_the_devices_logs_the_round_and_is_raised():
    lab = Lab()
    lab.planner.hook = lambda: 1 / 0
    with pytest.raises(ZeroDivisionError):
        lab.run()
    assert lab.gripper.stops == 1 and lab.reasons == ["error"]
    assert "ZeroDivisionError" in lab.of(RoundFinished)[0].detail
    assert lab.of(RunFinished)[0].status == "error"


def test_a_keyboard_interrupt_from_elsewhere_is_a_stop():
    lab = Lab()

    def interrupt():
        raise KeyboardInterrupt

    lab.planner.hook = interrupt
    assert lab.run().exit_code == 130 and lab.reasons == ["stopped by the user"]


def test_stopped_is_what_the_shield_holds_back():
    lab = Lab()
    with lab.stop.shielded():
        lab.stop.request()
        lab.stop.request()
        lab.stop.check()
    with pytest.raises(Stopped):
        lab.stop.check()
