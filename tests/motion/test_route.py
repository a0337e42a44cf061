"""Every path is checked so densely that nothing on the arm, nor what it holds, moves 5 mm between two checks."""

import numpy as np
import pytest

from evg_app.motion.carry import Carry
from evg_app.motion.held import Held
from evg_app.motion.links import LinkCapsules
from evg_app.motion.path import blended, line, through
from evg_app.motion.route import CHECK_STEP, Router
from evg_app.motion.scene import Boxes, empty_scene, table_plane
from evg_app.motion.spheres import link_points
from evg_app.types import Box

SLACK = 1e-9
GAP_TOLERANCE = 1e-9
READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])


class Recording:
    """A checker that finds everything free and remembers what it was asked."""

    def __init__(self, checker):
        self._checker, self.seen = checker, []

    def __getattr__(self, name):
        return getattr(self._checker, name)

    def hits_at(self, frames, scene, gripper=True, radius=None):
        self.seen.append(frames)
        return np.zeros(len(frames), dtype=bool)


def spread(planner, frames):
    """How far any mesh vertex of the arm moves between neighbours of frames."""
    largest = np.zeros(len(frames) - 1)
    for item in planner.kinematics.meshes.geometryObjects:
        T = frames[:, int(item.parentJoint)]
        p = link_points(item) @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
        largest = np.maximum(largest, np.linalg.norm(np.diff(p, axis=0), axis=2).max(axis=1))
    return largest


def ordered(frames, path, kinematics):
    """Frames in the order of the path."""
    dense = kinematics.frames(path.even(4000))[:, 7, :3, 3]
    at = np.argmin(np.linalg.norm(frames[:, None, 7, :3, 3] - dense[None], axis=2), axis=1)
    return frames[np.argsort(at, kind="stable")]


def paths(planner):
    k = planner.kinematics
    rng = np.random.default_rng(0)
    a, b, c = (READY + rng.uniform(-0.5, 0.5, 7) for _ in range(3))
    poses = np.tile(k.fk_hand(READY), (17, 1, 1))
    poses[:, 2, 3] -= np.linspace(0, 0.08, 17)
    straight = k.follow(poses, READY[6:], k.search(poses[0], READY).branch[:1])[0]
    return {"line": line(a, b), "rounded": blended(np.stack([a, b, c]), 16), "approach": through(straight)}


@pytest.mark.parametrize("name", ["line", "rounded", "approach"])
def test_no_point_of_the_arm_moves_5_mm_between_checks(planner, robot, name):
    path = paths(planner)[name]
    checker = Recording(planner.checker)
    checker.self_collision = type("Never", (), {"any_collides": lambda self, q: False})()
    router = Router(checker)
    assert router.is_free(path, router.strict(empty_scene(robot)))
    frames = ordered(np.concatenate(checker.seen), path, planner.kinematics)
    ends = planner.kinematics.frames(path.even(2))
    np.testing.assert_allclose(frames[[0, -1]], ends, atol=1e-9)
    assert spread(planner, frames).max() <= CHECK_STEP + SLACK


def held_sphere(robot, offset, radius=0.02):
    """Something small fixed to the hand."""
    center = np.array([offset], dtype=float)
    return Held(center, np.array([radius]), None, None, Boxes.of(()), table_plane(robot))


def test_what_is_held_moves_no_further_than_the_bound_either(planner, robot):
    held = held_sphere(robot, (0.0, 0.0, 0.35))
    path = line(READY, READY + np.array([0.4, 0.2, 0.1, -0.3, 0.6, 0.3, 0.9]))
    frames = planner.kinematics.frames(path.even(50))
    hands = frames[:, 7] @ planner.kinematics.geometry.T_7_hand
    carry = Carry.transport(held, hands[0], hands[-1])
    bound = planner._router.moved(frames, carry)
    tip = hands @ [0.0, 0.0, 0.37, 1.0]
    assert (np.linalg.norm(np.diff(tip, axis=0), axis=1) <= bound + SLACK).all()
    assert (spread(planner, frames) <= bound + SLACK).all()


def test_a_thin_sheet_between_coarse_checks_is_seen(planner, robot):
    k = planner.kinematics
    a, b = READY.copy(), READY.copy()
    a[0], b[0] = -0.6, 0.6
    tip = k.fk_hand(READY) @ [0.0, 0.0, 0.1, 1.0]
    sheet = Boxes.of((Box("sheet", (0.04, 0.001, 0.04), (tip[0], 0.03, tip[2])),))
    held = Held(np.array([[0.0, 0.0, 0.1]]), np.array([0.001]), None, None, sheet, table_plane(robot))
    T_start, T_end = k.fk_hand(a), k.fk_hand(b)
    carry = Carry.transport(held, T_start, T_end)
    assert not carry.hits(k.fk_hand(line(a, b).even(9))).any()
    assert planner._router.carry_hits(line(a, b), carry)


def test_capsule_gaps_match_hand_values():
    links = LinkCapsules(np.array([1]), np.array([[0.0, 0, 0]]), np.array([[0.0, 0, 0.2]]), np.array([0.05]))
    frames = np.tile(np.eye(4), (1, 8, 1, 1))
    points = np.array([[[0.1, 0.0, 0.1], [0.0, 0.0, 0.3], [0.0, 0.02, 0.05]]])
    np.testing.assert_allclose(links.gap(frames, points), [[0.05, 0.05, -0.03]], atol=GAP_TOLERANCE)


def test_an_object_may_not_be_swung_into_the_arm_that_holds_it(planner, robot):
    k = planner.kinematics
    folded = np.array([0.0, -0.6, 0.0, -2.9, 0.0, 3.4, 0.785])
    T_start, T_end = k.fk_hand(READY), k.fk_hand(folded)
    upper_arm = next(c for c in k.link_primitives(folded) if c.name == "panda_link3")
    offset = np.linalg.inv(T_end) @ [*((upper_arm.p0 + upper_arm.p1) / 2), 1.0]
    held = held_sphere(robot, offset[:3], 0.03)
    router = planner._router
    hands = k.fk_hand(np.stack([READY, folded]))
    frames = k.frames(np.stack([READY, folded]))
    plain = Carry.transport(held, T_start, T_end)
    beside = plain.beside(planner.checker.links, frames[0], T_start)
    assert plain.hits_arm(frames, hands).tolist() == [False, False]
    assert beside.hits_arm(frames, hands).tolist() == [False, True]
    assert router.carry_hits(line(READY, folded), beside)


def test_a_part_that_begins_close_to_the_arm_may_leave_but_not_come_closer(planner, robot):
    k = planner.kinematics
    frames, T = k.frames(READY[None])[0], k.fk_hand(READY)
    inside_link6 = np.linalg.inv(T) @ [*frames[6, :3, 3], 1.0]
    held = held_sphere(robot, inside_link6[:3])
    carry = Carry.lift(held, T).beside(planner.checker.links, frames, T)
    assert not carry.hits_arm(frames[None], T[None])[0]
