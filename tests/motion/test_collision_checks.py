"""Self-collision, the sphere covers, the distance field, and the open gripper against surface points."""

import numpy as np
import pinocchio as pin
import pytest

from evg_app.config.robot_files import collision_urdf, resolve
from evg_app.motion.field import DistanceField
from evg_app.motion.gripper import approach_hits, lift_hits
from evg_app.motion.kinematics import load_arm
from evg_app.motion.scene import Boxes, Scene, SceneView, empty_scene, prepare, surface_points, table_plane
from evg_app.motion.spheres import MARGIN, SLACK, cover, link_points, surface_samples
from evg_app.types import Box, CollisionVolume, TsdfGrid

READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
FOLDED = np.array([0.0, 1.7, 0.0, -3.0, 0.0, 3.5, 0.0])
SURFACE_TOLERANCE = 1e-3
OPENING = 0.08
SWEEP = 0.08


def test_known_poses_are_free_or_in_self_collision(planner):
    assert not planner.checker.self_collision.collides(READY)
    assert planner.checker.self_collision.collides(FOLDED)


def test_capsules_judge_like_the_39_primitives(planner, robot):
    model, geometry = load_arm(robot, collision_urdf(resolve(robot.urdf)))
    assert len(geometry.geometryObjects) == 39
    geometry.addAllCollisionPairs()
    pin.removeCollisionPairs(model, geometry, str(resolve(robot.srdf)))
    data, geometry_data = model.createData(), geometry.createData()
    k = planner.kinematics
    q = np.random.default_rng(0).uniform(k.lower, k.upper, (400, 7))
    ours = [planner.checker.self_collision.collides(row) for row in q]
    theirs = [bool(pin.computeCollisions(model, data, geometry, geometry_data, row, True)) for row in q]
    assert ours == theirs and any(ours) and not all(ours)


def test_adjacent_links_are_not_paired(planner):
    pairs = planner.checker.self_collision.pairs()
    assert frozenset(("panda_link1", "panda_link2")) not in pairs
    assert frozenset(("panda_link0", "panda_hand")) in pairs


def test_spheres_cover_the_link_and_stick_out_little(planner):
    link = next(g for g in planner.kinematics.meshes.geometryObjects if g.name.startswith("panda_link6"))
    points = link_points(link)
    centers, radii = cover(points)
    fine = surface_samples(points, 0.006)
    bare = (np.linalg.norm(fine[:, None] - centers[None], axis=2) - radii).min(axis=1)
    assert bare.max() < MARGIN
    assert radii.max() < np.linalg.norm(np.ptp(points, axis=0)) / 2 + SLACK


def test_field_is_the_distance_to_the_nearest_voxel_and_a_lower_bound_outside():
    occupied = np.zeros((30, 30, 30), dtype=bool)
    occupied[[3, 20, 12], [4, 9, 25], [5, 28, 1]] = True
    origin, voxel = np.array([0.1, -0.2, 0.05]), 0.02
    field = DistanceField(occupied, origin, voxel)
    centers = origin + (np.argwhere(occupied) + 0.5) * voxel
    points = np.random.default_rng(0).uniform(origin - 0.5, origin + 1.1, (500, 3))
    true = np.linalg.norm(points[:, None] - centers[None], axis=2).min(axis=1)
    found = field.at(points)
    assert (found <= true + voxel).all()
    inside = ((points > origin) & (points < origin + 0.6)).all(axis=1)
    assert np.abs(found - true)[inside].max() < voxel


def test_an_empty_volume_is_far_from_everything():
    field = DistanceField(np.zeros((8, 8, 8), dtype=bool), np.zeros(3), 0.02)
    assert (field.at(np.random.default_rng(0).normal(size=(20, 3))) > 1.0).all()


def test_box_distance_matches_hand_values():
    boxes = Boxes.of((Box("b", (0.2, 0.2, 0.2), (0.0, 0.0, 0.0)),))
    points = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.2, 0.2, 0.1]])
    np.testing.assert_allclose(boxes.distance(points), [0.0, 0.2, np.hypot(0.1, 0.1)], atol=1e-12)


def test_surface_points_lie_on_the_surface_of_a_box(make_scene):
    view = make_scene([((0.15, 0.15, 0.09), (0.03, 0.04, 0.04))])
    points = surface_points(view.tsdf)
    on_table = np.abs(points[:, 2] - 0.05) < SURFACE_TOLERANCE
    q = np.abs(points - [0.15, 0.15, 0.09]) - [0.03, 0.04, 0.04]
    on_box = np.abs(q.max(axis=1)) < SURFACE_TOLERANCE
    assert (on_table | on_box).mean() > 0.97
    assert on_box.sum() > 200


def test_prepare_drops_table_voxels_and_voxels_inside_the_arm(planner, robot):
    occupied = np.zeros((64, 64, 64), dtype=bool)
    origin, voxel = np.array([0.1, -0.4, -0.15]), 0.0125
    hand = planner.kinematics.fk_hand(READY)[:3, 3]
    spots = {"table": [0.5, 0.0, 0.003], "arm": hand, "object": [0.5, 0.1, 0.1]}
    for p in spots.values():
        occupied[tuple(np.floor((np.asarray(p) - origin) / voxel).astype(int))] = True
    empty = np.zeros((40, 40, 40), dtype=np.float32)
    view = SceneView(TsdfGrid(empty, empty > 1), CollisionVolume(occupied, occupied, origin, voxel))
    scene = prepare(robot, view, planner.kinematics.link_primitives(READY))
    distance = {name: float(scene.field.at(np.asarray(p))) for name, p in spots.items()}
    assert distance["object"] < 1.5 * voxel
    assert distance["arm"] > 0.05 and distance["table"] > 0.05


def test_the_arm_touches_table_boxes_and_observed_voxels(planner, robot):
    scene = empty_scene(robot)
    assert not planner.checker.hits_scene(READY[None], scene)[0]
    low = planner.kinematics.fk_hand(READY)
    low[2, 3] = 0.08
    q_low = planner.kinematics.ik(low, READY)
    assert planner.checker.hits_scene(q_low[None], scene)[0]
    assert "table" in planner.checker.what_is_hit(q_low, scene)
    below_palm = planner.kinematics.fk_hand(READY)[:3, 3] - [0, 0, 0.08]
    boxed = Scene(scene.points, None, Boxes.of((Box("b", (0.03, 0.1, 0.03), tuple(below_palm)),)), scene.table)
    assert planner.checker.hits_scene(READY[None], boxed)[0]
    assert not planner.checker.hits_scene(READY[None], boxed, gripper=False)[0]
    occupied = np.zeros((10, 10, 10), dtype=bool)
    occupied[5, 5, 5] = True
    elbow = planner.checker.centers(READY[None])[0][planner.checker.body.names.index("panda_link4")]
    seen = Scene(scene.points, DistanceField(occupied, elbow - 0.11, 0.02), Boxes.of(()), scene.table)
    assert planner.checker.hits_scene(READY[None], seen, gripper=False)[0]


def test_link_culling_gives_the_same_answer_as_every_sphere(planner, robot):
    rng = np.random.default_rng(0)
    k = planner.kinematics
    scene = empty_scene(robot)
    occupied = rng.random((40, 40, 40)) < 0.001
    scene = Scene(scene.points, DistanceField(occupied, np.array([0.1, -0.4, 0.0]), 0.02), scene.boxes, scene.table)
    q = rng.uniform(k.lower, k.upper, (200, 7))
    every = [(planner.checker.clearance(row, scene) < planner.checker.body.radius).any() for row in q]
    culled = planner.checker.hits_scene(q, scene)
    assert culled.tolist() == every and culled.any() and not culled.all()


def around(robot, points):
    return Scene(np.asarray(points, dtype=float), None, Boxes.of(()), table_plane(robot))


def cluster(center):
    return np.asarray(center) + np.random.default_rng(0).uniform(-0.003, 0.003, (30, 3))


@pytest.fixture
def pointing_down():
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = (0.5, 0.0, 0.2)
    return T


def test_a_target_between_the_open_fingers_is_free(planner, robot, pointing_down):
    target = [0.5, 0.0, 0.2 - 0.04] + np.random.default_rng(0).uniform(-1, 1, (500, 3)) * [0.02, 0.036, 0.03]
    assert not approach_hits(planner._gripper, around(robot, target), pointing_down, OPENING, SWEEP)


@pytest.mark.parametrize("where", [[0.5, 0.05, 0.16], [0.5, -0.05, 0.16], [0.5, 0.09, 0.23], [0.5, 0.05, 0.2]])
def test_fingers_and_hand_hit_what_is_in_their_way(planner, robot, pointing_down, where):
    assert approach_hits(planner._gripper, around(robot, cluster(where)), pointing_down, OPENING, SWEEP)


def test_only_the_sweep_meets_what_is_above_the_hand(planner, robot, pointing_down):
    above = around(robot, cluster([0.5, 0.09, 0.34]))
    assert approach_hits(planner._gripper, above, pointing_down, OPENING, SWEEP)
    assert not approach_hits(planner._gripper, above, pointing_down, OPENING, 0.0)


def test_a_few_stray_points_do_not_veto(planner, robot, pointing_down):
    stray = around(robot, [[0.5, 0.05, 0.16], [0.5, -0.05, 0.16]])
    assert not approach_hits(planner._gripper, stray, pointing_down, OPENING, SWEEP)


def test_finger_tips_may_not_enter_the_table(planner, robot, pointing_down):
    nothing = around(robot, np.zeros((0, 3)))
    pointing_down[2, 3] = 0.052
    assert not approach_hits(planner._gripper, nothing, pointing_down, OPENING, SWEEP)
    pointing_down[2, 3] = 0.050
    assert approach_hits(planner._gripper, nothing, pointing_down, OPENING, SWEEP)


def test_lift_ignores_the_target_but_not_a_shelf_above(planner, robot, pointing_down):
    poses = np.tile(pointing_down, (3, 1, 1))
    poses[:, 2, 3] += [0.05, 0.1, 0.15]
    target = cluster([0.5, 0.0, 0.16])
    assert not lift_hits(planner._gripper, around(robot, target), pointing_down, poses, 0.04)
    shelf = cluster([0.5, 0.09, 0.36])
    assert lift_hits(planner._gripper, around(robot, np.concatenate([target, shelf])), pointing_down, poses, 0.04)
