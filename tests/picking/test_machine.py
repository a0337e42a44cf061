"""The loop on a lab without physics: order of states, accounting (spec §6.1, §11.8), evidence, seeds."""

import numpy as np
import pytest
from picking_fakes import OBJECT_WIDTH, Lab

from evg_app.events import (
    COMPUTE_STAGES,
    AttemptFinished,
    AttemptStarted,
    FrameTaken,
    GripperMoved,
    Judged,
    MotionEnded,
    MotionStarted,
    RunFinished,
    StageTimed,
)
from evg_app.picking.context import Settings

TIME_ATOL = 1e-6
"""Clock arithmetic [s]."""


def test_three_objects_are_cleared_in_the_order_of_the_issue():
    lab = Lab(objects=3)
    result = lab.run()
    one = [
        "look",
        "observe",
        "plan",
        "filter",
        "reach",
        "recheck",
        "approach",
        "close",
        "lift",
        "verify",
        "drop",
        "release",
        "return",
        "score",
    ]
    assert lab.states == one * 3
    assert lab.reasons == ["cleared"]
    assert (result.rounds[0].attempts, result.rounds[0].successes) == (3, 3)
    assert result.exit_code == 0 and lab.of(RunFinished)[0].status == "finished"


@pytest.mark.parametrize(
    ("script", "attempts", "successes"),
    [("FF", 2, 0), ("FSFF", 4, 1), ("FSFSFF", 6, 2), ("SFF", 3, 1), ("MLS", 2, 0)],
)
def test_two_failures_in_a_row_end_the_round(script, attempts, successes):
    lab = Lab(script=script, objects=8)
    result = lab.run()
    assert (result.rounds[0].attempts, result.rounds[0].successes) == (attempts, successes)
    assert lab.reasons == ["two consecutive failures"]


def test_no_grasp_and_no_feasible_grasp_and_an_empty_view_add_no_attempt():
    nothing, infeasible, blind = Lab(), Lab(), Lab(sees=False)
    nothing.planner.grasps = nothing.planner.plan(None).__class__.empty()
    infeasible.motion_planner.refuses = True
    for lab, reason, outcome in (
        (nothing, "no grasp", "no grasp"),
        (infeasible, "no feasible grasp", "no feasible grasp"),
        (blind, "no grasp", "empty view"),
    ):
        result = lab.run()
        assert result.rounds[0].attempts == 0
        assert (lab.reasons, lab.outcomes) == ([reason], [outcome])


def test_without_a_referee_an_empty_view_is_a_cleared_table_and_verify_counts():
    lab = Lab(objects=2, has_referee=False)
    result = lab.run()
    assert lab.reasons == ["cleared"]
    assert (result.rounds[0].attempts, result.rounds[0].successes) == (2, 2)
    assert lab.outcomes == ["success", "success", "empty view"]


def test_failures_name_their_reason_and_keep_their_evidence():
    lab = Lab(script="FSLSFF", objects=9)
    lab.run()
    finished = lab.of(AttemptFinished)
    assert [f.failure for f in finished][:4] == ["nothing held after lift", "", "lost in transit", ""]
    assert finished[0].verified is False and finished[0].evidence.width_closed == 0.0
    assert finished[1].evidence.width_lifted == OBJECT_WIDTH == finished[1].evidence.width_release
    assert finished[2].verified is False and finished[2].evidence.width_release == 0.0
    assert (finished[1].evidence.in_bin_before, finished[1].evidence.in_bin_after) == (0, 1)


def test_verify_and_truth_may_disagree_and_both_are_kept():
    lab = Lab(script="MF", objects=9)
    lab.run()
    missed = lab.of(AttemptFinished)[0]
    assert (missed.verified, missed.truth, missed.failure) == (True, False, "not in the bin")


def test_the_attempt_limit_ends_a_round():
    lab = Lab(script="S" * 9, objects=9, settings=Settings(max_attempts=4))
    assert lab.run().rounds[0].attempts == 4
    assert lab.reasons == ["attempt limit"]


def test_planner_seeds_differ_between_attempts_rounds_and_seeds_and_repeat_with_the_run():
    labs = [Lab(script="S" * 20), Lab(script="S" * 20)]
    for lab in labs:
        lab.run(rounds=2, seeds=(0, 1))
    seeds = labs[0].planner.seeds
    assert seeds == labs[1].planner.seeds and len(set(seeds)) == len(seeds) == 12
    assert [e.planner_seed for e in labs[0].of(AttemptStarted)] == seeds


def test_the_frame_is_exposed_after_the_arm_came_to_the_look_pose():
    lab = Lab()
    times = {}
    lab.listeners.append(lambda e: times.setdefault(type(e), lab.clock.now()))
    lab.run()
    look_ended = times[MotionEnded]
    assert lab.of(MotionStarted)[0].name == "look"
    assert lab.of(FrameTaken)[0].frame.stamp > look_ended


def test_device_time_of_an_attempt_is_the_clock_time_of_its_commands():
    lab = Lab(objects=1)
    lab.run()
    spent = sum(e.seconds for e in lab.of(MotionEnded)) + sum(e.seconds for e in lab.of(GripperMoved)) + 2 * 0.03
    assert lab.of(AttemptFinished)[0].motion_s == pytest.approx(spent, abs=TIME_ATOL)


def test_compute_time_counts_the_stages_from_depth_image_to_trajectory():
    lab = Lab(objects=1)
    lab.run()
    stages = lab.of(StageTimed)
    assert {s.stage for s in stages} >= set(COMPUTE_STAGES)
    counted = sum(s.wall_ms for s in stages if s.stage in (*COMPUTE_STAGES, "route"))
    assert lab.of(AttemptFinished)[0].compute_ms == pytest.approx(counted)


def test_judged_carries_what_replay_needs():
    lab = Lab(objects=1)
    lab.run()
    judged = lab.of(Judged)[0]
    assert judged.chosen == 0 and judged.T_base_grasp.shape == (4, 4)
    assert set(judged.trajectories) == {"reach", "approach", "lift", "transport", "back", "retreat"}
    assert np.array_equal(judged.trajectories["approach"].q[0], judged.trajectories["reach"].q[-1])
