"""The object in the hand, estimated from what is seen of it, and what it may touch while it is carried.

What is seen between the fingers is grown to the surface connected with it. One camera sees one side: the cluster is
mirrored about the vertical through the grasp, and continued down to what it stands on; never into space seen free.
Where things touch, the cluster is more than the object. What overlaps the estimate where it stands cannot be told from
it and does not hinder the lift; where no way is left even so, smaller estimates follow.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from evg_app.config.models import RobotConfig
from evg_app.geometry import MAX_OPENING, Array, invert
from evg_app.motion.field import DistanceField
from evg_app.motion.scene import Boxes, Plane, Scene, declared_boxes
from evg_app.types import Box

NEIGHBOUR = 0.012
"""Surface points this close to each other belong together [m]."""
REACH = 0.12
"""How far from the grasp an object reaches, sideways and up [m]."""
DOWN = 0.25
"""How far it may hang below the grasp [m]."""
CLUTTERED_REACH = 0.08
"""The distance in every direction where the cluster goes on beyond `REACH`: several objects that touch [m]."""
INSIDE = 0.015
"""The grasp centre lies this far inside the finger tips [m]."""
FINGER = 0.015
"""Half the length, across the opening, of the space between the fingers in which the object is looked for [m]."""
GRAIN = 0.008
"""Spacing of the points below and behind the seen surface [m]."""
BOTTOM = 0.003
"""How close to the table an object's own points come [m]."""
ABOVE_TABLE = 0.014
"""From this height on, space above the table can be seen to be free [m]: below, its surface is too near."""
MAX_SPHERES = 40
"""Spheres that stand for one object at most."""
HELD_MARGIN = 0.01
"""Clearance of the held object from table and declared boxes [m]."""
SEEN_MARGIN = 0.004
"""Clearance from centres of occupied voxels [m]."""
RIM_CLEARANCE = 0.03
"""Clearance from the top of the bin's walls [m]."""
SHORT = 0.05
"""How far below the finger tips a reduced estimate reaches [m]."""
OVERLAP = 0.004
"""Centres of occupied voxels this close to the estimate overlap it [m]."""


@dataclass(frozen=True)
class Held:
    """A held object as spheres, and the world it is carried through.

    Attributes:
        center: in the frame the spheres are given in: the base at the moment of the grasp, or the hand. (S, 3) [m].
        radius: [m]. Shape (S,).
        field: distance to what is seen of everything else, or None.
        beside: the same without what the estimate overlaps where it stands; of this the lift keeps clear.
        boxes: declared boxes, the bin's walls raised so that the object clears the rim.
        table: the table plane.
    """

    center: Array
    radius: Array
    field: DistanceField | None
    beside: DistanceField | None
    boxes: Boxes
    table: Plane

    def attached(self, T_base_hand: Array) -> "Held":
        """From spheres in the base frame to spheres in the frame of the hand that grasps (4, 4)."""
        T = invert(T_base_hand)
        return replace(self, center=self.center @ T[:3, :3].T + T[:3, 3])

    def shortened(self, tips_height: float) -> "Held":
        """Without what hangs more than `SHORT` below finger tips at this height over the table [m]; base frame."""
        low = self.table.height(self.center) - self.radius
        keep = low > tips_height - SHORT - GRAIN
        return replace(self, center=self.center[keep], radius=self.radius[keep])

    def placed(self, T_base_hand: Array) -> Array:
        """Sphere centres in the base frame for hands at (N, 4, 4). Shape (N, S, 3) [m]."""
        R, p = T_base_hand[:, :3, :3], T_base_hand[:, :3, 3]
        placed: Array = self.center @ R.transpose(0, 2, 1) + p[:, None]
        return placed

    def clearance(self, T_base_hand: Array) -> Array:
        """Distance [m] of every centre to table, boxes and seen things, margins taken off. Shape (3, N, S)."""
        p = self.placed(T_base_hand)
        table = self.table.height(p) - HELD_MARGIN
        boxes = self.boxes.distance(p) - HELD_MARGIN
        seen = np.full_like(table, np.inf) if self.field is None else self.field.at(p) - SEEN_MARGIN
        return np.stack([table, boxes, seen])

    def lowest(self, T_base_hand: Array) -> float:
        """Height over the table of the object's lowest point, hand at (4, 4) [m]; infinite without spheres."""
        if len(self.radius) == 0:
            return float("inf")
        return float((self.table.height(self.placed(T_base_hand[None])[0]) - self.radius).min())


def estimates(robot: RobotConfig, scene: Scene, T_base_grasp: Array, width: float, tip: float) -> Iterator[Held]:
    """What a grasp would hold, as spheres in the base frame: first all that may belong to it, then less.

    The second leaves out what hangs deep below the finger tips, the third all that open fingers cannot have between
    them; the rest of the cluster then does not hinder the lift. Only the first where nothing is seen.

    Args:
        robot: for bin and obstacles.
        scene: what was observed.
        T_base_grasp: shape (4, 4).
        width: opening at the grasp [m].
        tip: where the finger tips end on the grasp's z axis [m].
    """
    centre = T_base_grasp[:3, 3] + (tip - INSIDE) * T_base_grasp[:3, 2]
    own = own_points(scene, T_base_grasp, centre, width, tip)
    seen = scene.points[own]
    boxes = Boxes.of((*(_raised(box) for box in declared_boxes(robot)), *scene.extra))
    field = _without(scene.field, seen)
    if not own.any():
        yield Held(centre[None], np.array([width / 2]), field, field, boxes, scene.table)
        return
    volume = _filled(scene, seen, scene.points[~own], centre)
    center, radius = to_spheres(volume, GRAIN / 2)
    beside = None if field is None else field.outside(center, radius + OVERLAP)
    whole = Held(center, radius, field, beside, boxes, scene.table)
    yield whole
    tips = scene.table.height(T_base_grasp[:3, 3] + tip * T_base_grasp[:3, 2])
    yield whole.shortened(float(tips))
    volume = volume[_between_open_fingers(volume, T_base_grasp)]
    center, radius = to_spheres(volume if len(volume) else centre[None], GRAIN / 2)
    field = _without(scene.field, seen[_between_open_fingers(seen, T_base_grasp)])
    yield Held(center, radius, field, beside, boxes, scene.table).shortened(float(tips))


def _without(field: DistanceField | None, seen: Array) -> DistanceField | None:
    """The field without the voxels of these surface points (P, 3)."""
    return None if field is None else field.without(seen, 1.2)


def _between_open_fingers(points: Array, T_base_grasp: Array) -> NDArray[np.bool_]:
    """Which points (P, 3) are no further from the grasp's approach axis than an open finger. Shape (P,)."""
    p = (points - T_base_grasp[:3, 3]) @ T_base_grasp[:3, :2]
    return np.asarray(np.linalg.norm(p, axis=1) < MAX_OPENING / 2)


def own_points(scene: Scene, T_base_grasp: Array, centre: Array, width: float, tip: float) -> NDArray[np.bool_]:
    """Which of the scene's surface points belong to the object between the fingers. Shape (P,)."""
    points, up = scene.points, scene.table.normal
    own = np.zeros(len(points), dtype=np.bool_)
    above = (points - centre) @ up
    aside = np.linalg.norm(points - centre - above[:, None] * up, axis=1)
    near = np.flatnonzero((aside < REACH) & (above < REACH) & (above > -DOWN))
    if len(near) == 0:
        return own
    p = (points[near] - T_base_grasp[:3, 3]) @ T_base_grasp[:3, :3]
    between = (np.abs(p[:, 0]) < FINGER) & (np.abs(p[:, 1]) < width / 2 + GRAIN / 2)
    between &= (p[:, 2] > tip - 3 * FINGER) & (p[:, 2] < tip + GRAIN)
    tree = cKDTree(points[near])
    graph = tree.sparse_distance_matrix(tree, NEIGHBOUR, output_type="coo_matrix")
    _, label = connected_components(graph, directed=False)
    member = np.isin(label, np.unique(label[between]))
    if member.any() and aside[near][member].max() > REACH - NEIGHBOUR:
        member &= np.linalg.norm(points[near] - centre, axis=1) < CLUTTERED_REACH
    own[near[member]] = True
    return own


def _filled(scene: Scene, seen: Array, others: Array, centre: Array) -> Array:
    """The seen surface, what lies below it, and its mirror image, without space that is free or others'. (V, 3)."""
    tree, up = cKDTree(others) if len(others) else None, scene.table.normal

    def outside(p: Array) -> NDArray[np.bool_]:
        """Which points (..., 3) lie in the table, in space seen free, or in others' surface."""
        height = scene.table.height(p)
        out = (height < BOTTOM) | scene.free(p + np.maximum(ABOVE_TABLE - height, 0.0)[..., None] * up)
        if tree is not None:
            out |= np.isfinite(tree.query(p, distance_upper_bound=GRAIN)[0])
        return np.asarray(out)

    cells = np.unique(np.round(seen / GRAIN).astype(np.int64), axis=0) * GRAIN
    depth = np.arange(1, int((REACH + DOWN) / GRAIN)) * GRAIN
    columns = cells[:, None] - depth[:, None] * up
    under = columns[~np.logical_or.accumulate(outside(columns), axis=1)]
    solid = np.unique(np.round(np.concatenate([cells, under]) / GRAIN).astype(np.int64), axis=0) * GRAIN
    offset = solid - centre
    along = np.outer(offset @ up, up)
    mirrored = centre + 2 * along - offset
    return np.concatenate([seen, solid, mirrored[~outside(mirrored)]])


def to_spheres(points: Array, padding: float) -> tuple[Array, Array]:
    """At most `MAX_SPHERES` spheres that hold all points (V, 3), each `padding` deep: centres (S, 3), radii (S,)."""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    side = 0.02
    while True:
        count = np.maximum(np.ceil(size / side), 1)
        cell = np.minimum((points - low) / np.maximum(size, 1e-9) * count, count - 1).astype(np.int64)
        used, member = np.unique(cell, axis=0, return_inverse=True)
        if len(used) <= MAX_SPHERES:
            break
        side *= 1.15
    high, bottom = np.full((len(used), 3), -np.inf), np.full((len(used), 3), np.inf)
    member = member.reshape(-1)
    np.maximum.at(high, member, points)
    np.minimum.at(bottom, member, points)
    center = (high + bottom) / 2
    radius = np.zeros(len(used))
    np.maximum.at(radius, member, np.linalg.norm(points - center[member], axis=1))
    return center, radius + padding


def _raised(box: Box) -> Box:
    """A wall of the bin, higher, so that `HELD_MARGIN` from it is `RIM_CLEARANCE` from the rim."""
    if not box.name.startswith("bin wall"):
        return box
    more = RIM_CLEARANCE - HELD_MARGIN
    (sx, sy, sz), (x, y, z) = box.size, box.center
    return Box(box.name, (sx, sy, sz + more), (x, y, z + more / 2))
