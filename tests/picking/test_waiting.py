"""A wait ends when it should, whatever the clock does."""

import pytest
from picking_fakes import FakeClock, Lab, line

from evg_app.picking.devices import backwards
from evg_app.picking.stop import StopToken
from evg_app.picking.verify import held
from evg_app.picking.waiting import Budget, measured
from evg_app.types import GripperState

SLICE = 0.02
"""Length of a wait slice [s]."""


@pytest.mark.parametrize("drift", [SLICE, 0.0, -5.0, 1e6])
def test_a_budget_ends_near_its_timeout_on_a_good_frozen_backward_or_jumping_clock(drift):
    clock = FakeClock()
    budget, slices = Budget(clock, 1.0, SLICE), 0
    while budget.spend():
        clock.t += drift
        slices += 1
        assert slices < 1000
    assert 45 <= slices <= 52


def test_measured_time_is_never_negative_and_bounded():
    clock = FakeClock(t=10.0)
    assert measured(clock, 12.0, 5.0) == 0.0
    assert measured(clock, 9.0, 5.0) == 1.0
    assert measured(clock, 0.0, 5.0) == 5.0


def test_soft_requests_by_the_program_never_make_a_hard_stop():
    stop = StopToken()
    stop.request_soft()
    stop.request_soft()
    assert stop.soft and not stop.hard
    stop.request()
    assert stop.hard


def test_a_trajectory_backwards_ends_where_it_began_and_keeps_its_speeds():
    there = line(0.0, 1.0)
    back = backwards(there)
    assert (back.q[0] == there.q[-1]).all() and (back.q[-1] == there.q[0]).all()
    assert back.duration == there.duration


@pytest.mark.parametrize(
    ("width", "expected"), [(0.0, False), (0.002, False), (0.004, True), (0.05, True), (0.0795, False), (0.08, False)]
)
def test_held_means_neither_closed_nor_open(width, expected):
    gripper = Lab().context().robot.gripper
    assert held(GripperState(0.0, width, not expected), gripper) is expected
