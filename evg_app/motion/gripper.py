"""The open gripper against surface points: boxes in the grasp frame, swept along the approach.

A sweep along the boxes' own z axis is again a box, so the straight approach is checked exactly and in one pass. The
space between the open fingers belongs to no box: the target may be there.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.geometry import Array, invert
from evg_app.motion.scene import Scene
from evg_app.motion.spheres import CORNERS, link_points, surface_samples

SLABS = 4
"""Slices along the approach that the hand and each finger are boxed in."""
OUTER_MARGIN = 0.002
"""How much boxes grow away from the target [m]."""
INNER_TOLERANCE = 0.003
"""How deep target points may lie in the fingers' inner faces and the palm [m]: half a voxel of sensor error."""
MIN_POINTS = 3
"""Surface points that make a contact; fewer are noise."""
TABLE_CLEARANCE = 0.001
"""Least height of every part of the gripper above the table plane [m]."""
TARGET_RADIUS = 0.06
"""Points this close to the point between the finger tips move with the object when it is lifted [m]."""


@dataclass(frozen=True)
class GripperBoxes:
    """Boxes in the grasp frame: `low` and `high` corners (B, 3) [m], fingers as if the opening were zero.

    Attributes:
        side: +1 or -1 for boxes of the finger on +y or -y, 0 for the hand. Shape (B,).
    """

    low: Array
    high: Array
    side: Array

    def opened(self, opening: float) -> tuple[Array, Array]:
        """Corners with the fingers `opening` [m] apart. Shape (B, 3) each."""
        shift = np.zeros_like(self.low)
        shift[:, 1] = self.side * opening / 2
        return self.low + shift, self.high + shift

    def inflated(self, opening: float) -> tuple[Array, Array]:
        """Corners with `OUTER_MARGIN`, and `INNER_TOLERANCE` taken off the faces that look at the target."""
        low, high = self.opened(opening)
        low, high = low - OUTER_MARGIN, high + OUTER_MARGIN
        low[self.side > 0, 1] += OUTER_MARGIN + INNER_TOLERANCE
        high[self.side < 0, 1] -= OUTER_MARGIN + INNER_TOLERANCE
        high[self.side == 0, 2] -= OUTER_MARGIN + INNER_TOLERANCE
        return low, high

    def corners(self, opening: float) -> Array:
        """All corners in the grasp frame. Shape (8 B, 3) [m]."""
        low, high = self.opened(opening)
        middle, half = (low + high) / 2, (high - low) / 2
        corners: Array = (middle[:, None] + CORNERS[None] * half[:, None]).reshape(-1, 3)
        return corners


def gripper_boxes(meshes: Any, robot: RobotConfig, T_7_hand: Array) -> GripperBoxes:
    """Boxes around the slices of the hand's and the fingers' collision meshes, loaded with the fingers open."""
    T_grasp_7 = invert(T_7_hand)
    T_grasp_7[2, 3] -= robot.gripper.hand_to_grasp_z_m
    low, high, side = [], [], []
    for name, points in _gripper_points(meshes, robot).items():
        p = surface_samples(points, 0.004) @ T_grasp_7[:3, :3].T + T_grasp_7[:3, 3]
        which = 0.0 if name == robot.model_hand_link else float(np.sign(p[:, 1].mean()))
        p[:, 1] -= which * robot.gripper.max_width_m / 2
        edges = np.linspace(p[:, 2].min(), p[:, 2].max(), SLABS + 1)
        for a, b in pairwise(edges.tolist()):
            slab = p[(p[:, 2] >= a - 0.002) & (p[:, 2] <= b + 0.002)]
            low.append([*slab[:, :2].min(axis=0), a])
            high.append([*slab[:, :2].max(axis=0), b])
            side.append(which)
    return GripperBoxes(np.array(low), np.array(high), np.array(side))


def gripper_links(meshes: Any, robot: RobotConfig) -> tuple[str, ...]:
    """Names of the hand and of every link that comes after it in the collision model."""
    names = [str(item.name).rsplit("_", 1)[0] for item in meshes.geometryObjects]
    return tuple(dict.fromkeys(names[names.index(robot.model_hand_link) :]))


def _gripper_points(meshes: Any, robot: RobotConfig) -> dict[str, Array]:
    """Hull points of hand and fingers by link name, in the frame of joint 7. Shape (V, 3) each [m]."""
    wanted = gripper_links(meshes, robot)
    points: dict[str, Array] = {}
    for item in meshes.geometryObjects:
        name = str(item.name).rsplit("_", 1)[0]
        if name in wanted:
            points[name] = np.concatenate([points.get(name, np.zeros((0, 3))), link_points(item)])
    return points


def approach_hits(boxes: GripperBoxes, scene: Scene, T_base_grasp: Array, opening: float, sweep: float) -> bool:
    """Whether the open gripper touches the scene anywhere on its last `sweep` [m] to the grasp (4, 4).

    Space that nothing saw is solid for the hand where the policy says so, never for the fingers: one of them has to go
    behind the target.
    """
    if _hits_table(boxes, scene, T_base_grasp, opening):
        return True
    low, high = boxes.inflated(opening)
    low[:, 2] -= sweep
    hand = boxes.side == 0
    if len(scene.unseen) and _hits_points(low[hand], high[hand], scene.unseen, T_base_grasp):
        return True
    return _hits_points(low, high, scene.points, T_base_grasp) or _hits_declared(boxes, scene, T_base_grasp, opening)


def lift_hits(boxes: GripperBoxes, scene: Scene, T_base_grasp: Array, poses: Array, opening: float) -> bool:
    """Whether the closed gripper touches the scene at poses (K, 4, 4) after the grasp (4, 4).

    Points near the grasp or between the fingers are the target's and move with the gripper.
    """
    p = (scene.points - T_base_grasp[:3, 3]) @ T_base_grasp[:3, :3]
    low, high = boxes.inflated(opening)
    reach = float(high[boxes.side != 0, 2].max())
    target = np.linalg.norm(p - [0.0, 0.0, reach], axis=1) < TARGET_RADIUS
    target |= (np.abs(p[:, 1]) < opening / 2 + INNER_TOLERANCE) & (np.abs(p[:, 0]) < 0.03) & (p[:, 2] > 0.0)
    others = scene.points[~target]
    return any(
        _hits_points(low, high, others, T)
        or _hits_table(boxes, scene, T, opening)
        or _hits_declared(boxes, scene, T, opening)
        for T in poses
    )


def _hits_points(low: Array, high: Array, points: Array, T_base_grasp: Array) -> bool:
    """Whether boxes in the grasp frame (4, 4), corners (B, 3), hold at least `MIN_POINTS` of the points (P, 3)."""
    p = (points - T_base_grasp[:3, 3]) @ T_base_grasp[:3, :3]
    p = p[((p > low.min(axis=0)) & (p < high.max(axis=0))).all(axis=1)]
    if len(p) == 0:
        return False
    inside = ((p[None] > low[:, None]) & (p[None] < high[:, None])).all(axis=2).any(axis=0)
    return int(inside.sum()) >= MIN_POINTS


def _hits_table(boxes: GripperBoxes, scene: Scene, T_base_grasp: Array, opening: float) -> bool:
    """Whether the gripper at a grasp (4, 4) comes too close to the table."""
    corners = boxes.corners(opening) @ T_base_grasp[:3, :3].T + T_base_grasp[:3, 3]
    return bool(scene.table.height(corners).min() < TABLE_CLEARANCE)


def _hits_declared(boxes: GripperBoxes, scene: Scene, T_base_grasp: Array, opening: float) -> bool:
    """Whether the gripper at a grasp (4, 4) comes too close to a declared box."""
    corners = boxes.corners(opening) @ T_base_grasp[:3, :3].T + T_base_grasp[:3, 3]
    return bool(scene.boxes.distance(corners).min() < OUTER_MARGIN)
