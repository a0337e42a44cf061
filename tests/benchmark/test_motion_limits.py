"""The benchmark's own reading of limits: it agrees with the planner's verifier and sees what is planted."""

import dataclasses

import numpy as np
import pytest

from evg_app.benchmark.motion.limits import TOLERANCE, broken, positions, worst_ratios
from evg_app.config.arm import NearEnds
from evg_app.config.files import load_robot
from evg_app.geometry import Array
from evg_app.motion.path import line
from evg_app.motion.trajectory import time_path
from evg_app.types import Trajectory

ROBOT = load_robot("panda")
LOOK, DROP = np.array(ROBOT.look_q_rad), np.array(ROBOT.drop.q_rad)
SAME_PLACE = 1e-3
"""Share of the allowed gap between two motions: rounding."""
FAST = 0.9
"""A quick motion reaches at least this share of some limit."""


@pytest.fixture(scope="module")
def there_and_back() -> tuple[Trajectory, Trajectory]:
    return time_path(line(LOOK, DROP), ROBOT), time_path(line(DROP, LOOK), ROBOT)


def with_q(motion: Trajectory, q: Array) -> Trajectory:
    return dataclasses.replace(motion, q=q)


def test_planned_motions_use_their_limits_and_break_none(there_and_back) -> None:
    ratios = worst_ratios(there_and_back, ROBOT)
    assert broken(ratios) == () and max(ratios.values()) > FAST
    assert ratios["join"] < SAME_PLACE


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_played_faster_they_break_velocity_acceleration_and_jerk(there_and_back, share: float) -> None:
    quick = [dataclasses.replace(motion, dt=motion.dt * share) for motion in there_and_back]
    assert {"acceleration", "jerk"} <= set(broken(worst_ratios(quick, ROBOT)))


def test_one_shifted_sample_is_found(there_and_back) -> None:
    q = there_and_back[0].q.copy()
    q[len(q) // 2, 3] += 1e-3
    assert "jerk" in broken(worst_ratios([with_q(there_and_back[0], q)], ROBOT))


def test_a_motion_that_stops_while_it_moves_breaks_acceleration(there_and_back) -> None:
    cut = with_q(there_and_back[0], there_and_back[0].q[: len(there_and_back[0].q) // 2])
    assert "acceleration" in broken(worst_ratios([cut], ROBOT))


def test_a_gap_between_two_motions_is_found(there_and_back) -> None:
    first, second = there_and_back
    assert broken(worst_ratios([first, with_q(second, second.q + 1e-4)], ROBOT)) == ("join",)


def test_positions_are_the_urdf_s_and_leaving_them_is_found(there_and_back) -> None:
    low, high = positions(ROBOT)
    assert (low < LOOK).all() and (high > LOOK).all()
    assert "position" in broken(worst_ratios([with_q(there_and_back[0], there_and_back[0].q + (high - LOOK))], ROBOT))


def test_limits_near_joint_ends_count_where_the_arm_has_them(there_and_back) -> None:
    low, high = positions(ROBOT)
    tight = NearEnds(lower_rad=tuple(low), upper_rad=tuple(high), gain=(1e-3,) * 7, offset_rad_s=(0.0,) * 7)
    limits = ROBOT.limits.model_copy(update={"near_ends": tight})
    assert "velocity" in broken(worst_ratios(there_and_back, ROBOT.model_copy(update={"limits": limits})))


def test_not_a_number_breaks_everything_it_touches() -> None:
    assert broken({"velocity": float("nan"), "jerk": 1.0 + TOLERANCE / 2}) == ("velocity",)
