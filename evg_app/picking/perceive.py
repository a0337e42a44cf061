"""The perception of a table in front of an arm: `evg_app.perception` put together for the loop."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from evg_app.geometry import FINGER_DEPTH, TABLE_HEIGHT, WORKSPACE_SIZE, Array, invert
from evg_app.perception import self_filter
from evg_app.perception.change import SceneChange, scene_change
from evg_app.perception.health import MIN_VALID, depth_health
from evg_app.perception.projection import points_in
from evg_app.perception.table import fit_table, rescale
from evg_app.perception.tsdf import fuse
from evg_app.perception.volume import fuse_volume
from evg_app.picking.context import View
from evg_app.types import Capsule, Frame

EDGE = 0.02
"""Points closer than this to a side of the workspace do not count as seen objects [m] (spec §6.1)."""
ABOVE_TABLE = 0.005
"""Points count as objects from this height above the table on [m] (spec §6.1)."""
CAMERA_STILL = 1e-3
"""A camera that moved by less than this stood still [m, or entries of the rotation]."""
STRIDE = 2
"""Every STRIDE-th row and column is looked at when counting points."""


class TablePerception:
    """Implements `picking.context.Perception`.

    Args:
        T_base_task: where the workspace is. Shape (4, 4).
        camera_pose: T_base_cam (4, 4) for joint positions [rad]: constant for a fixed camera.
        links: the arm's links for joint positions [rad], removed from the depth image.
        table_is_ruler: multiply depth by the factor that brings the seen table to its known height.
        min_valid: least share of the workspace's pixels with depth, for a frame that may be planned on.
    """

    def __init__(
        self,
        T_base_task: Array,
        camera_pose: Callable[[Array], Array],
        links: Callable[[Array], Sequence[Capsule]],
        table_is_ruler: bool = False,
        min_valid: float = MIN_VALID,
    ) -> None:
        self._T_base_task, self._camera_pose, self._links = T_base_task, camera_pose, links
        self._table_is_ruler, self._min_valid = table_is_ruler, min_valid

    @property
    def T_base_task(self) -> Array:
        """Where the workspace is. Shape (4, 4)."""
        return self._T_base_task

    def T_base_cam(self, q: Array) -> Array:
        """Where the camera is. Shape (4, 4)."""
        return self._camera_pose(q)

    def clean(self, frame: Frame, q: Array) -> Frame:
        """The frame without the arm's own links."""
        T_cam_base = invert(self.T_base_cam(q))
        depth, _ = self_filter.remove_links(
            frame.depth, frame.intrinsics, T_cam_base, self._links(q), depth_scale=frame.depth_scale
        )
        return replace(frame, depth=depth.astype(np.uint16, copy=False))

    def problem(self, frame: Frame, q: Array) -> str:
        """Why no plan may be made on this frame, empty when it is good enough."""
        return depth_health(frame, self._T_cam_task(q), self._min_valid).advice

    def blind(self, frame: Frame, q: Array) -> str:
        """Why this frame shows nothing at all, empty when it does: the arm may stand before the whole workspace."""
        health = depth_health(frame, self._T_cam_task(q), self._min_valid)
        return health.advice if health.valid < self._min_valid else ""

    def view(self, frame: Frame, q: Array, further: Sequence[tuple[Frame, Array]] = ()) -> View:
        """Fuse clean frames into the planner's grid and the collision volume; each is ruled by itself."""
        factor = fit_table(frame, self._T_cam_task(q)).scale if self._table_is_ruler else 1.0
        seen = [(rescale(frame, factor), q), *((self._ruled(other, at), at) for other, at in further)]
        volume = fuse_volume([(one, invert(self.T_base_cam(at))) for one, at in seen], self._T_base_task)
        in_task = [(one, self._T_cam_task(at)) for one, at in seen]
        points = max(points_above_table(one, T_cam_task) for one, T_cam_task in in_task)
        return View(fuse(in_task), volume, points, factor)

    def change(
        self, before: tuple[Frame, Array], after: tuple[Frame, Array], T_base_grasp: Array, radius: float, step: float
    ) -> SceneChange:
        """What changed within `radius` [m] of where a grasp (4, 4) closes, by more than `step` [m] of depth.

        A camera that has moved since then compares nothing.
        """
        T_base_cam = self.T_base_cam(after[1])
        if np.abs(T_base_cam - self.T_base_cam(before[1])).max() > CAMERA_STILL:
            return SceneChange(0.0, 0.0)
        old, new = (self._ruled(self.clean(frame, q), q) for frame, q in (before, after))
        place = T_base_grasp[:3, 3] + FINGER_DEPTH * T_base_grasp[:3, 2]
        return scene_change(old, new, invert(T_base_cam), place, radius, step)

    def _ruled(self, frame: Frame, q: Array) -> Frame:
        """A clean frame with the table at its known height, where the table is the ruler."""
        return rescale(frame, fit_table(frame, self._T_cam_task(q)).scale) if self._table_is_ruler else frame

    def _T_cam_task(self, q: Array) -> Array:
        """The task frame in the camera. Shape (4, 4)."""
        return np.asarray(invert(self.T_base_cam(q)) @ self._T_base_task)


def points_above_table(frame: Frame, T_cam_task: Array) -> int:
    """How many (sub-sampled) measured points lie above the table inside the workspace."""
    sparse = frame.depth[::STRIDE, ::STRIDE].astype(np.float32) * np.float32(frame.depth_scale)
    points = points_in(sparse, frame.intrinsics, T_cam_task, STRIDE)
    low = np.array([EDGE, EDGE, TABLE_HEIGHT + ABOVE_TABLE], dtype=np.float32)
    high = np.array([WORKSPACE_SIZE - EDGE, WORKSPACE_SIZE - EDGE, WORKSPACE_SIZE], dtype=np.float32)
    return int(((points > low[:, None]) & (points < high[:, None])).all(axis=0).sum())
