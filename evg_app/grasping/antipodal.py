"""Antipodal heuristic: the baseline that learns nothing, for comparison only.

Samples surface points, approaches each against its normal and from above under several yaws, drops hypotheses
whose hand touches a seen surface or the table, and ranks the rest by how squarely the closing region's outermost
points face the fingers (as the heuristics that VGN and GIGA compare with).
"""

from dataclasses import dataclass

import numpy as np

from evg_app.geometry import FINGER_DEPTH, MAX_OPENING, TABLE_HEIGHT, Array, make
from evg_app.grasping.protocol import Grid, grid_values
from evg_app.grasping.selection import WIDTH_RANGE, Mask, suppress
from evg_app.grasping.surface import SurfacePoints, surface_points
from evg_app.types import Grasps

FINGER_HALF_X = 0.010
"""Half extent of the fingers along the thickness axis [m]."""
FINGER_THICKNESS = 0.014
"""Extent of an open finger outwards along the closing axis [m]."""
PALM_DEPTH = 0.05
"""How far the hand reaches behind the grasp centre [m] (collision check)."""
CONTACT_SLICE = 0.006
"""Points this close to the outermost one count as its contact [m]."""
TABLE_CLEARANCE = 0.003
"""Least height of the open finger tips above the table [m]; steep approaches are drawn back to it."""
CHUNK = 256
"""Hypotheses scored at a time."""


@dataclass(frozen=True)
class AntipodalConfig:
    """How many hypotheses, and which are kept.

    Attributes:
        points: surface points sampled.
        yaws: hand angles about each approach.
        insert: how far the finger tips go past the point [m].
        min_points: seen points that must lie between the fingers.
        threshold: least score of a grasp.
    """

    points: int = 80
    yaws: int = 8
    insert: float = 0.025
    min_points: int = 4
    threshold: float = 0.2


class AntipodalPlanner:
    """The heuristic behind the planners' interface."""

    name = "antipodal"
    weights_sha256 = ""

    def __init__(self, config: AntipodalConfig | None = None) -> None:
        self.config = config or AntipodalConfig()

    def plan(self, grid: Grid, seed: int = 0) -> Grasps:
        """Ranked grasps, best first; see `Planner.plan`."""
        seen = surface_points(grid_values(grid))
        objects = seen.on_objects()
        if len(objects.points) == 0:
            return Grasps.empty()
        T = self._hypotheses(objects, np.random.default_rng(abs(seed)))
        T = T[_lowest_tip(T) > TABLE_HEIGHT + TABLE_CLEARANCE - 1e-6]
        judged = [self._judge(T[i : i + CHUNK], seen) for i in range(0, len(T), CHUNK)]
        if not judged:
            return Grasps.empty()
        score, width, offset = (np.concatenate(part) for part in zip(*judged, strict=True))
        keep = score >= self.config.threshold
        T, score, width, offset = T[keep], score[keep], width[keep], offset[keep]
        T[:, :3, 3] += T[:, :3, 1] * offset[:, None]
        order = suppress(T, score, radius=0.015, angle=np.pi / 6)
        return Grasps(T[order], width[order], score[order])

    def _hypotheses(self, objects: SurfacePoints, rng: np.random.Generator) -> Array:
        """Grasps at sampled points, against the normal and from above, under all yaws. Shape (N, 4, 4)."""
        count = min(self.config.points, len(objects.points))
        chosen = rng.choice(len(objects.points), count, replace=False)
        normals = np.concatenate([objects.normals[chosen], np.tile([0.0, 0.0, 1.0], (count, 1))])
        points = np.concatenate([objects.points[chosen]] * 2)
        normals, points = normals[normals[:, 2] > -0.1], points[normals[:, 2] > -0.1]
        yaw = (np.arange(self.config.yaws) + rng.uniform()) * np.pi / self.config.yaws
        R = np.concatenate([_frames(-normals, angle) for angle in yaw])
        points = np.tile(points, (self.config.yaws, 1))
        T = make(R, points - R[:, :, 2] * (FINGER_DEPTH - self.config.insert))
        lift = np.maximum(TABLE_HEIGHT + TABLE_CLEARANCE - _lowest_tip(T), 0.0)
        steep = T[:, 2, 2] < -0.5
        T[steep, :3, 3] += T[steep, :3, 2] * (lift[steep] / T[steep, 2, 2])[:, None]
        return T

    def _judge(self, T: Array, seen: SurfacePoints) -> tuple[Array, Array, Array]:
        """Score in [0, 1], width [m] and shift along the closing axis [m] that centres it, of grasps (N, 4, 4)."""
        R, t = T[:, :3, :3], T[:, :3, 3]
        x, y, z = (R[:, :, a] @ seen.points.T - (R[:, :, a] * t).sum(1)[:, None] for a in range(3))
        x = np.abs(x)
        facing = R[:, :, 1] @ seen.normals.T
        inside = (x < FINGER_HALF_X) & (np.abs(y) < MAX_OPENING / 2) & (z > 0.0) & (z < FINGER_DEPTH)
        high = np.where(inside, y, -np.inf).max(1)
        low = np.where(inside, y, np.inf).min(1)
        left = inside & (y > high[:, None] - CONTACT_SLICE)
        right = inside & (y < low[:, None] + CONTACT_SLICE)
        score = 0.5 * (_mean(facing, left) - _mean(facing, right)) * _preference(R)
        enough = inside.sum(1) >= self.config.min_points
        width = np.where(enough, high - low, 0.0) + 2 * 0.002
        fits = enough & (width >= WIDTH_RANGE[0]) & (width <= WIDTH_RANGE[1])
        free = ~_touches(x, np.abs(y), z).any(1)
        offset = np.where(fits, 0.5 * (np.where(enough, high, 0.0) + np.where(enough, low, 0.0)), 0.0)
        return np.where(fits & free, np.clip(score, 0.0, 1.0), 0.0), width, offset


def _touches(x: Array, y: Array, z: Array) -> Mask:
    """Whether points, in the grasp frame with |x| and |y| [m], lie in an open finger or the palm. Shape (N, P)."""
    fingers = (x < FINGER_HALF_X) & (y > MAX_OPENING / 2) & (y < MAX_OPENING / 2 + FINGER_THICKNESS)
    fingers &= (z > -PALM_DEPTH) & (z < FINGER_DEPTH)
    palm = (x < 0.02) & (y < 0.10) & (z > -PALM_DEPTH) & (z < 0.0)
    touched: Mask = fingers | palm
    return touched


def _preference(R: Array) -> Array:
    """Prior in [0, 1]: from above, and closing level, as one view does not show the far side. (N, 3, 3) -> (N,)."""
    above = 0.5 + 0.5 * np.clip(-R[:, 2, 2], 0.0, 1.0)
    prior: Array = above * np.sqrt(np.clip(1.0 - R[:, 2, 1] ** 2, 0.0, 1.0))
    return prior


def _mean(values: Array, where: Mask) -> Array:
    """Mean over the last axis of the values `where` true, 0 if none."""
    mean: Array = np.where(where, values, 0.0).sum(1) / np.maximum(where.sum(1), 1)
    return mean


def _frames(approach: Array, yaw: float) -> Array:
    """Rotations whose third column is `approach` (N, 3), turned by `yaw` [rad] about it. Shape (N, 3, 3)."""
    helper = np.where(np.abs(approach[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    a = np.cross(helper, approach)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(approach, a)
    y = np.cos(yaw) * a + np.sin(yaw) * b
    return np.stack([np.cross(y, approach), y, approach], axis=2)


def _lowest_tip(T: Array) -> Array:
    """Height of the lower one of the open finger tips [m]. Shape (N,)."""
    reach = MAX_OPENING / 2 + FINGER_THICKNESS
    lowest: Array = T[:, 2, 3] + T[:, 2, 2] * FINGER_DEPTH - np.abs(T[:, 2, 1]) * reach
    return lowest
