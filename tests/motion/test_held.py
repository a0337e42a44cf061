"""What the hand holds is estimated well enough, and carried clear of table, bin and neighbours, level and slowly."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from evg_app.geometry import MAX_OPENING, rotation_about
from evg_app.motion.carry import CONTACT_LIFT, Carry
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.held import CLUTTERED_REACH, MAX_SPHERES, RIM_CLEARANCE, estimates, to_spheres
from evg_app.motion.kinematics import hand_of_grasp
from evg_app.motion.scene import Boxes, declared_boxes, prepare
from evg_app.motion.trajectory import limits, verify

COVER_TOLERANCE = 0.004
STICK_OUT = 0.022
MARGIN = 0.01
HEIGHT_TOLERANCE = 2e-3
DIP_TOLERANCE = 0.031
BOX = ((0.15, 0.15, 0.09), (0.02, 0.03, 0.04))
BOTTLE = ((0.15, 0.15, 0.125), (0.02, 0.02, 0.075))
WIDTH = 0.045


def samples(box, step=0.005):
    center, half = (np.asarray(x) for x in box)
    axes = [np.linspace(-h, h, max(int(2 * h / step), 2)) for h in half]
    return center + np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def bare(held, points):
    """How far points lie outside every sphere [m]."""
    return (cdist(points, held.center) - held.radius).min(axis=1)


@pytest.fixture(scope="module")
def hold(planner, robot, make_scene):
    """Boxes and a grasp in the task frame -> estimate in the base frame."""

    def build(boxes, T_task_grasp, width=WIDTH):
        scene = prepare(robot, make_scene(boxes), planner.kinematics.link_primitives(planner.look_q))
        return next(estimates(robot, scene, robot.T_base_task.matrix() @ T_task_grasp, width, 0.05))

    return build


@pytest.fixture(scope="module")
def in_base(robot):
    return lambda points: points + robot.T_base_task.matrix()[:3, 3]


@pytest.fixture(scope="module")
def bottle_pick(planner, make_scene, top_grasp, as_grasps):
    grasps = as_grasps(top_grasp((0.15, 0.15, 0.185)), width=WIDTH)
    pick = planner.plan_pick(grasps, make_scene([BOTTLE]), planner.look_q).pick
    assert pick is not None
    return pick


def test_a_box_on_the_table_is_covered_and_hardly_more(hold, in_base, top_grasp):
    held = hold([BOX], top_grasp((0.15, 0.15, 0.11)))
    assert 0 < len(held.radius) <= MAX_SPHERES
    assert bare(held, in_base(samples(BOX))).max() < COVER_TOLERANCE
    low, high = in_base(np.subtract(*BOX)), in_base(np.add(*BOX))
    assert ((held.center - held.radius[:, None]) > low - STICK_OUT).all()
    assert ((held.center + held.radius[:, None]) < high + STICK_OUT).all()


def test_a_bottle_held_at_its_top_reaches_down_to_the_table(hold, in_base, top_grasp):
    held = hold([BOTTLE], top_grasp((0.15, 0.15, 0.185)))
    assert bare(held, in_base(samples(BOTTLE))).max() < COVER_TOLERANCE
    short = held.shortened(0.135)
    assert 0 < len(short.radius) < len(held.radius)
    assert short.lowest(np.eye(4)) > held.lowest(np.eye(4)) + 0.03


def test_the_unseen_back_is_mirrored_but_not_into_free_space(planner, robot, make_scene, in_base, top_grasp):
    scene = prepare(robot, make_scene([BOX]), planner.kinematics.link_primitives(planner.look_q))
    T = robot.T_base_task.matrix() @ top_grasp((0.15, 0.15, 0.11))
    seen = scene.points[scene.points[:, 1] < 0.005]
    hidden = type(scene)(seen, scene.field, scene.boxes, scene.table)
    assert bare(next(estimates(robot, hidden, T, WIDTH, 0.05)), in_base(samples(BOX))).max() < COVER_TOLERANCE
    aside = T.copy()
    aside[1, 3] += 0.015
    free = next(estimates(robot, scene, aside, WIDTH, 0.05))
    assert (free.center[:, 1] + free.radius).max() < 0.03 + STICK_OUT
    assert not scene.free(in_base(samples(BOX))).any()


def test_of_two_boxes_that_touch_only_what_is_near_is_held(hold, in_base, top_grasp):
    neighbour = ((0.15 + 0.09, 0.15, 0.09), (0.05, 0.03, 0.04))
    wide = ((0.15 - 0.03, 0.15, 0.09), (0.04, 0.03, 0.04))
    held = hold([wide, neighbour], top_grasp((0.12, 0.15, 0.11)))
    centre = in_base(np.array([0.12, 0.15, 0.125]))
    assert np.linalg.norm(held.center - centre, axis=1).max() < CLUTTERED_REACH + COVER_TOLERANCE
    far = in_base(samples(neighbour))
    assert (bare(held, far) > 0).mean() > 0.5


def test_in_touching_clutter_the_estimate_shrinks_to_what_open_fingers_hold(planner, robot, make_scene, top_grasp):
    neighbour = ((0.15 + 0.045, 0.15, 0.11), (0.025, 0.03, 0.06))
    scene = prepare(robot, make_scene([BOX, neighbour]), planner.kinematics.link_primitives(planner.look_q))
    T = robot.T_base_task.matrix() @ top_grasp((0.15, 0.15, 0.11))
    whole, short, core = estimates(robot, scene, T, WIDTH, 0.05)
    assert len(short.radius) <= len(whole.radius)
    aside = np.linalg.norm((core.center - T[:3, 3]) @ T[:3, :2], axis=1)
    assert 0 < aside.max() < MAX_OPENING / 2 + 0.02
    assert whole.center[:, 0].max() > core.center[:, 0].max() + 0.02


def test_what_overlaps_the_estimate_where_it_stands_does_not_hinder_the_lift(hold, robot, top_grasp):
    T_hand = hand_of_grasp(robot, robot.T_base_task.matrix() @ top_grasp((0.15, 0.15, 0.11)))
    taller = ((0.15, 0.217, 0.14), (0.02, 0.02, 0.09))
    held = hold([BOX, taller], top_grasp((0.15, 0.15, 0.11))).attached(T_hand)
    up, into = (np.array([T_hand]) for _ in range(2))
    up[0, 2, 3] += 0.06
    into[0, :3, 3] += [0.0, 0.06, 0.06]
    hits = Carry.lift(held, T_hand).hits(np.concatenate([up, into])).tolist()
    assert hits == [False, True]


def test_boxes_that_stand_apart_are_not_held(hold, in_base, top_grasp):
    other = ((0.15, 0.23, 0.09), (0.02, 0.02, 0.04))
    held = hold([BOX, other], top_grasp((0.15, 0.15, 0.11)))
    alone = hold([BOX], top_grasp((0.15, 0.15, 0.11)))
    np.testing.assert_allclose(held.center.max(axis=0), alone.center.max(axis=0), atol=0.01)
    assert float(held.field.at(in_base(np.array([0.15, 0.23, 0.13])))) < 0.02
    assert float(held.field.at(in_base(np.array([0.15, 0.15, 0.13])))) > 0.02


def test_where_nothing_is_seen_something_small_is_held(hold, top_grasp):
    held = hold([], top_grasp((0.15, 0.15, 0.11)))
    assert len(held.radius) == 1
    assert held.radius[0] == pytest.approx(WIDTH / 2)


def test_spheres_hold_every_point_and_are_few():
    points = np.random.default_rng(0).uniform(0, 1, (3000, 3)) * [0.05, 0.08, 0.2]
    center, radius = to_spheres(points, 0.004)
    assert len(radius) <= MAX_SPHERES
    assert (cdist(points, center) - radius).min(axis=1).max() < 0


def test_a_tall_object_is_carried_clear_of_the_bin_and_the_table(planner, robot, bottle_pick, in_base):
    pick = bottle_pick
    T_hand = hand_of_grasp(robot, pick.T_base_grasp)
    points = in_base(samples(BOTTLE, 0.01)) - T_hand[:3, 3]
    points = points @ T_hand[:3, :3]
    T = planner.kinematics.fk_hand(pick.transport.q)
    carried = points @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
    assert Boxes.of(declared_boxes(robot)).distance(carried).min() > MARGIN
    assert carried[..., 2].min() > MARGIN
    rim = robot.drop.bin_center_m[2] + robot.drop.bin_size_m[2]
    assert carried[-1, :, 2].min() > rim + RIM_CLEARANCE - HEIGHT_TOLERANCE
    ends = T[[0, -1], 2, 3].min()
    assert T[:, 2, 3].min() > ends - DIP_TOLERANCE


def test_a_tall_object_is_dropped_from_higher_up_and_above_the_bin(planner, robot, bottle_pick):
    T = planner.kinematics.fk_hand(bottle_pick.transport.q[-1])
    tip = T @ [0, 0, 0.112, 1]
    low = planner.kinematics.fk_hand(planner.drop_q) @ [0, 0, 0.112, 1]
    np.testing.assert_allclose(tip[:2], low[:2], atol=1e-3)
    assert tip[2] > low[2] + 0.005
    np.testing.assert_array_equal(bottle_pick.back.q[0], bottle_pick.transport.q[-1])


def test_carry_scale_slows_lift_and_transport_within_the_limits(robot, make_scene, top_grasp, as_grasps, bottle_pick):
    slower = robot.limits.model_copy(update={"carry_scale": 0.3})
    slow_robot = robot.model_copy(update={"limits": slower})
    grasps = as_grasps(top_grasp((0.15, 0.15, 0.185)), width=WIDTH)
    planner = MotionPlanner(slow_robot)
    slow = planner.plan_pick(grasps, make_scene([BOTTLE]), planner.look_q).pick
    for name in ("lift", "transport"):
        q = getattr(bottle_pick, name)
        assert getattr(slow, name).duration > 1.3 * q.duration
        assert (np.abs(q.dq) <= robot.limits.carry_scale * limits(robot)[0] * (1 + 1e-6)).all()
        verify(q, robot)
    assert slow.reach.duration == bottle_pick.reach.duration


def test_equal_inputs_give_equal_carries(robot, make_scene, top_grasp, as_grasps, bottle_pick):
    planner = MotionPlanner(robot)
    grasps = as_grasps(top_grasp((0.15, 0.15, 0.185)), width=WIDTH)
    again = planner.plan_pick(grasps, make_scene([BOTTLE]), planner.look_q).pick
    np.testing.assert_array_equal(again.transport.q, bottle_pick.transport.q)
    np.testing.assert_array_equal(again.lift.q, bottle_pick.lift.q)


def test_contact_with_a_neighbour_is_tolerated_only_where_the_lift_begins(robot, hold, top_grasp):
    other = ((0.15, 0.225, 0.09), (0.02, 0.02, 0.04))
    T_hand = hand_of_grasp(robot, robot.T_base_task.matrix() @ top_grasp((0.15, 0.15, 0.11)))
    held = hold([BOX, other], top_grasp((0.15, 0.15, 0.11))).attached(T_hand)
    carry = Carry.lift(held, T_hand)
    up, aside, barely = (np.array([T_hand]) for _ in range(3))
    up[0, 2, 3] += 0.15
    aside[0, 1, 3] += 0.06
    barely[0, 1, 3] += CONTACT_LIFT - 0.005
    assert carry.hits(np.concatenate([up, aside, barely])).tolist() == [False, True, False]


def test_transport_may_not_dip_nor_tilt(planner, robot, hold, top_grasp):
    T = planner.kinematics.fk_hand(planner.drop_q)
    held = hold([], top_grasp((0.15, 0.15, 0.11))).attached(T)
    carry = Carry.transport(held, T, T)
    low, tilted = T.copy(), T @ rotation_about("x", 0.4)
    low[2, 3] -= DIP_TOLERANCE
    assert carry.hits(np.stack([T, low, tilted])).tolist() == [False, True, True]
