"""Labels of grasps on simple solids whose truth is known."""

import numpy as np
import pytest

from evg_app.geometry import TABLE_HEIGHT, Array, make, rotation_about
from evg_app.learning.candidates import BOUNDS, MAX_RISE, along_normals, from_contacts, perturbed, turned
from evg_app.learning.gripper import PAD_Z, finger_points, swept
from evg_app.learning.holds import WIDTH_OFFSET, check_holds
from evg_app.learning.labels import Kind, LabelledGrasps, WithContact, balance, label, sample_and_label, with_contact
from evg_app.learning.solids import CLOSE, FREE, SWEEP, SceneSolids, Solid
from evg_app.learning.surface import depth_inside, half_spaces, sample_occupancy, sample_surface
from evg_app.simulation.convex import cuboid
from evg_app.simulation.meshes import hull

WIDTH_TOLERANCE = 0.0005
DISTANCE_TOLERANCE = 1e-4
SHARE_TOLERANCE = 0.03

SIZE = np.array([0.05, 0.03, 0.08])
CENTER = np.array([0.15, 0.15, TABLE_HEIGHT + 0.04])


def solid(points: Array, owner: int = 0) -> Solid:
    mesh = hull(points)
    return Solid(owner, mesh.vertices, mesh.faces)


@pytest.fixture
def box() -> list[Solid]:
    """One upright box, 30 mm thick in y."""
    return [solid(cuboid(SIZE, CENTER))]


def top_down(tip_height: float, x: float = 0.15, y: float = 0.15, yaw: float = 0.0) -> Array:
    """A grasp from straight above, closing along y for yaw 0, finger tips at `tip_height`."""
    R = rotation_about("z", yaw)[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    return make(R, [x, y, tip_height + PAD_Z[1]])


def test_grasp_across_the_thin_side_is_positive_with_its_width(box: list[Solid]) -> None:
    found = label(SceneSolids(box), top_down(0.09)[None])
    assert found.kind.tolist() == [Kind.POSITIVE]
    assert found.owner.tolist() == [0]
    assert found.width[0] == pytest.approx(SIZE[1] + WIDTH_OFFSET, abs=WIDTH_TOLERANCE)


def test_closing_in_the_air_is_a_slip(box: list[Solid]) -> None:
    found = label(SceneSolids(box), top_down(CENTER[2] + 0.04 + 0.01)[None])
    assert found.kind.tolist() == [Kind.SLIP]


def test_hand_that_would_go_through_the_box_collides(box: list[Solid]) -> None:
    assert label(SceneSolids(box), top_down(0.09, y=0.15 + 0.03)[None]).kind.tolist() == [Kind.COLLISION]


def test_finger_tips_below_the_table_collide(box: list[Solid]) -> None:
    assert label(SceneSolids(box), top_down(TABLE_HEIGHT - 0.002)[None]).kind.tolist() == [Kind.COLLISION]


def test_obstacle_on_the_way_collides_though_the_grasp_itself_is_free(box: list[Solid]) -> None:
    roof = solid(cuboid([0.02, 0.02, 0.01], [0.15, 0.15 + 0.055, 0.20]), owner=1)
    grasp = top_down(0.09)
    assert SceneSolids(box).clearance(grasp[None])[0] >= FREE
    assert SceneSolids([*box, roof]).clearance(grasp[None])[0] <= CLOSE


def test_too_close_to_call_is_left_out() -> None:
    gap = (CLOSE + FREE) / 2
    scene = SceneSolids([solid(cuboid([0.05, 0.08 - 2 * gap, 0.08], CENTER))])
    grasp = top_down(0.09)
    assert scene.clearance(grasp[None])[0] == pytest.approx(gap, abs=DISTANCE_TOLERANCE)
    assert len(label(scene, grasp[None]).kind) == 0


def test_oblique_contact_slips() -> None:
    """A wedge whose sides lean 60 degrees squeezes out of the fingers."""
    base = cuboid([0.06, 0.07, 0.001], [0.15, 0.15, 0.08])
    ridge = np.array([[0.12, 0.15, 0.10], [0.18, 0.15, 0.10]])
    scene = SceneSolids([solid(np.concatenate([base, ridge]))])
    check = check_holds(scene, top_down(0.082)[None])
    assert check.slips[0] and not check.holds[0]


def test_two_objects_between_the_pads_do_not_hold() -> None:
    left = solid(cuboid([0.05, 0.01, 0.08], CENTER + np.array([0, 0.012, 0])), owner=0)
    right = solid(cuboid([0.05, 0.01, 0.08], CENTER - np.array([0, 0.012, 0])), owner=1)
    check = check_holds(SceneSolids([left, right]), top_down(0.09)[None])
    assert check.slips[0] and check.owner[0] == -1


def test_flipped_fingers_get_the_same_label(box: list[Solid]) -> None:
    scene, rng = SceneSolids(box), np.random.default_rng(0)
    points = sample_surface(box, half_spaces(box), 600, rng)
    grasps = from_contacts(scene, points, rng)
    flipped = grasps @ rotation_about("z", np.pi)
    assert np.abs(scene.clearance(grasps) - scene.clearance(flipped))[scene.clearance(grasps) > CLOSE].max() < 2e-3
    assert (check_holds(scene, grasps).holds == check_holds(scene, flipped).holds).mean() > 0.97


def test_candidates_stay_in_the_workspace_and_come_from_above(box: list[Solid]) -> None:
    scene, rng = SceneSolids(box), np.random.default_rng(1)
    points = sample_surface(box, half_spaces(box), 500, rng)
    first = from_contacts(scene, points, rng)
    for T in (first, along_normals(points, rng), perturbed(first, 200, rng), turned(first, 200, rng)):
        assert len(T) > 50
        assert np.abs(T[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2) - np.eye(3)).max() < 1e-9
        assert (np.linalg.det(T[:, :3, :3]) > 0.99).all()
        assert T[:, :2, 3].min() > BOUNDS[0] and T[:, :2, 3].max() < BOUNDS[1]
        assert T[:, 2, 2].max() < MAX_RISE


def test_hand_stopped_by_the_table_still_holds_when_contact_is_allowed() -> None:
    low = [solid(cuboid([0.05, 0.03, 0.03], [0.15, 0.15, TABLE_HEIGHT + 0.015]))]
    found = label(SceneSolids(low), top_down(TABLE_HEIGHT - 0.006)[None])
    assert found.kind.tolist() == [Kind.COLLISION]
    assert with_contact(SceneSolids(low), found).tolist() == [WithContact.HOLDS]


def test_hand_stopped_above_the_box_fails_even_when_contact_is_allowed(box: list[Solid]) -> None:
    found = label(SceneSolids(box), top_down(0.09, y=0.15 + 0.03)[None])
    assert with_contact(SceneSolids(box), found).tolist() == [WithContact.FAILS]


def test_thin_flat_objects_get_positives() -> None:
    plate = [solid(cuboid([0.10, 0.05, 0.012], [0.15, 0.15, TABLE_HEIGHT + 0.006]))]
    rng = np.random.default_rng(2)
    found = sample_and_label(SceneSolids(plate), sample_surface(plate, half_spaces(plate), 3000, rng), 3000, rng)
    assert (found.kind == Kind.POSITIVE).sum() >= 5


def test_balance_spreads_positives_over_objects_and_mixes_negatives() -> None:
    kind = np.array([Kind.POSITIVE] * 120 + [Kind.SLIP] * 80 + [Kind.COLLISION] * 800, dtype=np.uint8)
    owner = np.array([0] * 100 + [1] * 20 + [-1] * 880)
    grasps = LabelledGrasps(np.tile(np.eye(4), (1000, 1, 1)), kind, np.zeros(1000), owner)
    kept = balance(grasps, 40, 0.4, np.random.default_rng(0))
    assert np.bincount(kept.kind, minlength=3).tolist() == [24, 16, 40]
    assert np.bincount(kept.owner[kept.kind == Kind.POSITIVE]).tolist() == [20, 20]


def test_surface_points_lie_on_the_outside() -> None:
    two = [solid(cuboid(SIZE, CENTER)), solid(cuboid(SIZE, CENTER + np.array([0.03, 0, 0])))]
    planes = half_spaces(two)
    points = sample_surface(two, planes, 1000, np.random.default_rng(0))
    assert np.abs(depth_inside(points.position, planes).max(axis=1)).max() < 2e-4
    outside = depth_inside(points.position + 0.001 * points.normal, planes).max(axis=1)
    assert (outside < 0).mean() > 0.97


def test_occupancy_matches_the_solid(box: list[Solid]) -> None:
    planes, rng = half_spaces(box), np.random.default_rng(0)
    surface = sample_surface(box, planes, 500, rng)
    points, inside = sample_occupancy(surface, planes, 4000, rng)
    beyond = (np.abs(points.astype(np.float64) - CENTER) - SIZE / 2).max(axis=1)
    clear = np.abs(beyond) > DISTANCE_TOLERANCE
    assert clear.mean() > 0.95 and (inside == (beyond < 0))[clear].all()
    uniform = inside[:2800].mean()
    assert uniform == pytest.approx(SIZE.prod() / 0.3**3, abs=SHARE_TOLERANCE)


def test_swept_hull_begins_a_sweep_before_the_grasp() -> None:
    points = finger_points(+1)
    both = swept(points, SWEEP)
    assert both[:, 2].min() == pytest.approx(points[:, 2].min() - SWEEP)
    assert both[:, 2].max() == pytest.approx(PAD_Z[1], abs=0.0005)
