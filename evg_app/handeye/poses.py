"""Where to stop: small first motions around the start, then the reachable views that say most about the unknowns."""

from dataclasses import dataclass

import numpy as np

from evg_app.config.calibration import Mode
from evg_app.geometry import Array, invert, make, transform_points
from evg_app.handeye.boards import Board
from evg_app.handeye.refine import SCALE_PRIOR, UNKNOWNS, Fit, jacobian, known, through
from evg_app.handeye.rigid import exp
from evg_app.handeye.sample import Views
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.scene import empty_scene
from evg_app.types import Intrinsics

FIRST_TURN = 0.16
"""Turn of the first motions, when nothing is known yet [rad]."""
FIRST_SHIFT = 0.02
"""Shift of the first motions [m]."""
CANDIDATES = 160
"""Random views of which the best are taken."""
MAX_TILT = 0.75
"""Largest tilt of the board against the view [rad]."""
MAX_ROLL = 1.2
"""Largest turn of the board in the picture [rad]."""
EDGE_PX = 18.0
"""The board stays this far from the picture's edges."""
NEAREST, FARTHEST = 0.30, 0.90
"""Distances of the board from the camera [m]."""
PLATE_CLEARANCE = 0.03
"""Height above the table of a board in the hand, and its distance from the arm's links [m]."""
CAMERA_CLEARANCE = 0.10
"""Height above the table of a camera on the hand [m]."""
Q7_GRID = 13
"""Values of the arm's free joint that are tried for each pose."""
REACH_TRIES = 4
"""Arm configurations tried for each pose."""


FIRST_SCALES = (1.0, 0.6, -0.8)
"""Where a first motion cannot be reached, these multiples of it are tried."""


def first_motions(T_base_hand: Array) -> list[list[Array]]:
    """Hand poses around the start: turns about three axes, each with a shift and smaller ones to fall back on."""
    turns = [
        (1, 0, 0),
        (-1, 0, 0),
        (0, 1, 0),
        (0, -1, 0),
        (0, 0, 1.6),
        (0, 0, -1.6),
        (0.7, 0.7, 1.0),
        (-0.7, 0.7, -1.0),
    ]
    shifts = [(0, 1, 0), (1, 0, 1), (0, 0, -1), (-1, 0, 0), (1, 1, 0), (0, -1, 1), (-1, 1, 0), (1, -1, -1)]
    return [
        [
            T_base_hand @ make(exp(k * FIRST_TURN * np.array(turn)), k * FIRST_SHIFT * np.array(shift))
            for k in FIRST_SCALES
        ]
        for turn, shift in zip(turns, shifts, strict=True)
    ]


@dataclass(frozen=True)
class Reach:
    """Which hand poses the arm can take: inverse kinematics, joint limits, collisions with itself, table and boxes."""

    motion: MotionPlanner

    def configuration(self, T_base_hand: Array, near: Array) -> Array | None:
        """The nearest free configuration (J,) for a hand pose (4, 4), or None."""
        checker, kinematics, scene = self.motion.checker, self.motion.kinematics, empty_scene(self.motion.robot)
        q7 = np.append(np.linspace(kinematics.lower[6], kinematics.upper[6], Q7_GRID), near[6])
        for q in kinematics.search(T_base_hand, near, q7).q[:REACH_TRIES]:
            if not checker.hits_scene(q[None], scene)[0] and not checker.self_collision.collides(q):
                return np.asarray(q)
        return None

    def clear(self, q: Array, points: Array) -> bool:
        """Whether points (P, 3) of the base frame on a plate in the hand keep away from table and links."""
        scene = empty_scene(self.motion.robot)
        if (scene.table.height(points) < PLATE_CLEARANCE).any() or (scene.boxes.distance(points) < 0.01).any():
            return False
        links = [c for c in self.motion.kinematics.link_primitives(q) if not _in_hand(c.name)]
        for link in links:
            axis = link.p1 - link.p0
            along = np.clip((points - link.p0) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
            gap = np.linalg.norm(points - link.p0 - along[:, None] * axis, axis=1)
            if (gap < link.radius + PLATE_CLEARANCE / 2).any():
                return False
        return True


def _in_hand(name: str) -> bool:
    """Whether a link moves with the hand, so that a board in it cannot come nearer."""
    return any(word in name for word in ("hand", "finger", "link7", "link8"))


def hand_pose(mode: Mode, X: Array, Z: Array, T_cam_board: Array) -> Array:
    """T_base_hand that shows the board as `T_cam_board`. Shape (4, 4)."""
    A = X @ T_cam_board @ invert(Z)
    return A if mode == "eye-to-hand" else invert(A)


def random_view(rng: np.random.Generator, board: Board, K: Intrinsics, distance: float, roll: float) -> Array:
    """A T_cam_board anywhere in the picture, tilted, at about `distance` [m]. Shape (4, 4)."""
    z = float(np.clip(distance * rng.uniform(0.7, 1.3), NEAREST, FARTHEST))
    u, v = rng.uniform(0.15, 0.85) * K.width, rng.uniform(0.15, 0.85) * K.height
    azimuth, tilt = rng.uniform(-np.pi, np.pi), MAX_TILT * np.sqrt(rng.uniform())
    turn = exp(np.array([0.0, 0.0, roll + rng.uniform(-MAX_ROLL, MAX_ROLL)]))
    R = exp(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])) @ turn
    centre = z * np.array([(u - K.cx) / K.fx, (v - K.cy) / K.fy, 1.0])
    return make(R, centre - R @ board.center)


def visible(board: Board, K: Intrinsics, T_cam_board: Array) -> bool:
    """Whether the whole board is in the picture, with `EDGE_PX` to spare."""
    p = transform_points(T_cam_board, board.outline)
    if (p[:, 2] < 0.1).any():
        return False
    u, v = K.fx * p[:, 0] / p[:, 2] + K.cx, K.fy * p[:, 1] / p[:, 2] + K.cy
    inside = (u > EDGE_PX) & (u < K.width - EDGE_PX) & (v > EDGE_PX) & (v < K.height - EDGE_PX)
    return bool(inside.all())


@dataclass(frozen=True)
class Stop:
    """A planned stop: joint positions (J,) and the hand pose (4, 4) they give."""

    q: Array
    T_base_hand: Array


def plan_stops(
    reach: Reach, board: Board, K: Intrinsics, mode: Mode, fit: Fit, taken: Views, q: Array, count: int, seed: int
) -> list[Stop]:
    """The `count` reachable views that add most to what `taken` says (greedy D-optimal), in a short order."""
    rng = np.random.default_rng(seed)
    distance = float(np.median(taken.B[:, 2, 3]))
    first = taken.B[0][:3, :3]
    roll = float(np.arctan2(first[1, 0], first[0, 0]))
    stops: list[Stop] = []
    information: list[Array] = []
    for _ in range(CANDIDATES):
        T_cam_board = random_view(rng, board, K, distance, roll)
        if not visible(board, K, T_cam_board):
            continue
        hand = hand_pose(mode, fit.X, fit.Z, T_cam_board)
        stop = _stop(reach, board, mode, fit, hand, q)
        if stop is not None:
            stops.append(stop)
            information.append(_information(board, K, mode, fit, hand))
    chosen = _greedy(information, _taken(taken, fit), count)
    return _short_order([stops[k] for k in chosen], q)


def _stop(reach: Reach, board: Board, mode: Mode, fit: Fit, hand: Array, near: Array) -> Stop | None:
    """The stop of a hand pose when it can be reached with board or camera clear of everything; else None."""
    q = reach.configuration(hand, near)
    if q is None:
        return None
    if mode == "eye-to-hand":
        outline = transform_points(hand @ fit.Z, np.concatenate([board.outline, board.center[None]]))
        return Stop(q, hand) if reach.clear(q, outline) else None
    camera = (hand @ fit.X)[:3, 3]
    height = float(empty_scene(reach.motion.robot).table.height(camera))
    return Stop(q, hand) if height > CAMERA_CLEARANCE else None


def _taken(views: Views, fit: Fit) -> Array:
    """Information of views on the unknowns. Shape (16, 16)."""
    J = jacobian(through(views, fit.lens), fit.X, fit.Z, fit.scale, np.zeros(3), np.zeros(3))
    return np.asarray(np.einsum("mkp,mkq->pq", J, J))


def _information(board: Board, K: Intrinsics, mode: Mode, fit: Fit, hand: Array) -> Array:
    """What one view of the whole board says about the unknowns. Shape (16, 16)."""
    n = len(board.points)
    A = (hand if mode == "eye-to-hand" else invert(hand))[None]
    one = Views(A, A, np.zeros(n, np.int64), board.points, np.zeros((n, 2)), np.zeros(1, np.int64), K, mode)
    return _taken(one, fit)


def _greedy(information: list[Array], taken: Array, count: int) -> list[int]:
    """Indices of the choices that raise log det of the information most, one after the other."""
    total, chosen = taken + np.diag(np.maximum(known(SCALE_PRIOR), 1.0)), list[int]()
    stack = np.stack(information) if information else np.zeros((0, UNKNOWNS, UNKNOWNS))
    while len(chosen) < min(count, len(stack)):
        gain = np.linalg.slogdet(total + stack)[1]
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        total = total + stack[best]
    return chosen


def _short_order(stops: list[Stop], q: Array) -> list[Stop]:
    """Always the nearest next."""
    left, ordered = list(stops), list[Stop]()
    while left:
        nearest = min(range(len(left)), key=lambda k: float(np.abs(left[k].q - q).max()))
        ordered.append(left.pop(nearest))
        q = ordered[-1].q
    return ordered
