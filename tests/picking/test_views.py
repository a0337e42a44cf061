"""A camera on the hand looks from several poses: all are visited, fused and logged; its pose follows the arm."""

from dataclasses import replace

import numpy as np
import pytest
from picking_fakes import LOOK, Lab

from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.events import FrameTaken, MotionStarted, ViewTaken
from evg_app.geometry import camera_on_sphere
from evg_app.picking.perceive import TablePerception
from evg_app.picking.run import run_rounds
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.camera import render
from evg_app.simulation.world import SimRounds, SimWorld
from evg_app.trials.arrays import Gathered, views_of
from evg_app.types import Frame

SAME = 1e-5
"""Fusing a view with itself changes the grid by rounding only."""
HIDDEN = 0.5
"""Three views leave at most this share of the voxels above the table hidden that one leaves."""
AZIMUTHS_DEG = (-90, 30, 150)


def run_with_views(*poses):
    """One round of the fakes' lab whose robot has these `view_q_rad`."""
    lab = Lab("S", objects=1)
    ctx = lab.context()
    robot = ctx.robot.model_copy(update={"view_q_rad": poses})
    run_rounds(replace(ctx, robot=robot), lab, (0,), 1)
    return lab


@pytest.fixture(scope="module")
def scene():
    """Exact depth of a packed table from three sides, where each camera stood, and where the workspace is."""
    world = SimWorld(load_robot("panda"), load_world("packed"), builtin_objects("test"))
    SimRounds(world).prepare(0, 3)
    K = load_camera("d435i").simulated_intrinsics()
    frames, poses = [], []
    for azimuth in AZIMUTHS_DEG:
        poses.append(world.T_base_task @ camera_on_sphere([0.15, 0.15, 0.1], 0.6, np.radians(50), np.radians(azimuth)))
        _, metres = render(world.client, K, poses[-1], 0.1, 2.0)
        frames.append(Frame(np.rint(metres / 0.001).astype(np.uint16), 0.001, K, 0.0, "cam"))
    yield frames, poses, world.T_base_task
    world.close()


def eye_in_hand(scene) -> TablePerception:
    """Perception whose camera moves with the arm: the first joint says which of the poses it is at."""
    _, poses, T_base_task = scene
    return TablePerception(T_base_task, lambda q: poses[int(q[0])], lambda q: [])


def at(index: int) -> np.ndarray:
    return np.array([float(index), 0.0])


def test_views_are_taken_in_order_before_the_look_pose_and_fused_with_its_frame():
    first, second = (LOOK + 0.2,) * 7, (LOOK - 0.2,) * 7
    lab = run_with_views(first, second)
    names = [event.name for event in lab.of(MotionStarted)]
    assert names[:3] == ["view 1", "view 2", "look"]
    views = lab.of(ViewTaken)
    assert [view.index for view in views[:2]] == [0, 1]
    assert views[0].q == pytest.approx(first, abs=0.02) and views[1].q == pytest.approx(second, abs=0.02)
    assert lab.of(FrameTaken)[0].q == pytest.approx((LOOK,) * 7, abs=0.02)
    assert lab.perception.fused[0] == 2


def test_without_further_poses_nothing_more_is_done():
    lab = run_with_views()
    assert lab.of(ViewTaken) == []
    assert set(lab.perception.fused) == {0}


def test_every_attempt_looks_around_anew():
    lab = Lab("SS", objects=2)
    ctx = lab.context()
    robot = ctx.robot.model_copy(update={"view_q_rad": ((LOOK + 0.2,) * 7,)})
    run_rounds(replace(ctx, robot=robot), lab, (0,), 1)
    assert len(lab.of(ViewTaken)) == len(lab.of(FrameTaken)) >= 2
    assert set(lab.perception.fused) == {1}


def test_view_whose_motion_is_blocked_is_recovered_from_as_any_motion():
    lab = Lab("S", objects=1)
    ctx = lab.context()
    robot = ctx.robot.model_copy(update={"view_q_rad": ((9.0,) * 7,)})
    lab.motion_planner.route = lambda q_start, q_goal, view: None
    run_rounds(replace(ctx, robot=robot), lab, (0,), 1)
    assert lab.of(ViewTaken) == [] and "recovering" in lab.warnings


def test_further_views_see_more_of_the_workspace_and_agree_with_it(scene):
    frames, _, _ = scene
    perception = eye_in_hand(scene)
    one = perception.view(frames[0], at(0))
    three = perception.view(frames[0], at(0), [(frames[1], at(1)), (frames[2], at(2))])
    hidden = [int((~view.tsdf.observed[:, :, 7:]).sum()) for view in (one, three)]
    assert hidden[1] < HIDDEN * hidden[0]
    assert three.volume.occupied.sum() > one.volume.occupied.sum()
    table = (slice(3, 37), slice(3, 37), 6)
    both = one.tsdf.observed[table] & three.tsdf.observed[table]
    assert np.median(np.abs(one.tsdf.values[table] - three.tsdf.values[table])[both]) < 0.05


def test_the_same_view_twice_is_that_view(scene):
    frames, _, _ = scene
    perception = eye_in_hand(scene)
    once = perception.view(frames[0], at(0))
    twice = perception.view(frames[0], at(0), [(frames[0], at(0))])
    assert np.abs(once.tsdf.values - twice.tsdf.values).max() < SAME
    assert np.array_equal(once.tsdf.observed, twice.tsdf.observed)


def test_logged_views_come_back_as_they_were(scene):
    frames, poses, T_base_task = scene
    gathered = Gathered()
    for index in (1, 2, 1, 2):
        gathered.take(ViewTaken(index - 1, frames[index], at(index), poses[index]))
    gathered.take(FrameTaken(frames[0], at(0), poses[0], T_base_task))
    views = views_of(gathered.arrays())
    assert [view.index for view in views] == [0, 1]
    for view, index in zip(views, (1, 2), strict=True):
        assert np.array_equal(view.frame.depth, frames[index].depth)
        assert view.frame.intrinsics == frames[index].intrinsics
        assert np.array_equal(view.T_base_cam, poses[index]) and np.array_equal(view.q, at(index))
