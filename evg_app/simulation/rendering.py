"""Fast depth of a scene by ray casting (Open3D, embree): whole images or only the pixels that are needed."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import WORKSPACE_SIZE, Array, invert
from evg_app.simulation.meshes import Mesh
from evg_app.simulation.state import SceneState
from evg_app.simulation.views import FAR, NEAR
from evg_app.types import Intrinsics

TABLE_HALF_SIZE = 0.6
"""Half side of the drawn table, centred below the workspace [m]."""
_BAND = 32
"""Rows cast at a time: small arrays stay in the cache."""


class SceneCaster:
    """Casts camera rays at one scene; build it once per scene, then render as many views as wanted."""

    def __init__(self, state: SceneState, table: bool = True) -> None:
        import open3d as o3d

        self._tensor: Any = o3d.core.Tensor
        self._scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        for thing in state.objects:
            self._add(thing.visual())
        if table:
            self._add(_table(state.table_height))

    def _add(self, mesh: Mesh) -> None:
        self._scene.add_triangles(
            self._tensor(np.ascontiguousarray(mesh.vertices, dtype=np.float32)),
            self._tensor(np.ascontiguousarray(mesh.faces, dtype=np.uint32)),
        )

    def depth(self, intrinsics: Intrinsics, T_task_cam: Array) -> NDArray[np.float32]:
        """Depth image along the optical axis [m], 0 where nothing is in range. Shape (H, W)."""
        image = np.empty((intrinsics.height, intrinsics.width), dtype=np.float32)
        for top in range(0, intrinsics.height, _BAND):
            band = image[top : top + _BAND]
            v, u = np.mgrid[top : top + len(band), : intrinsics.width]
            pixels = np.stack([u.ravel(), v.ravel()], axis=1)
            band[:] = self.depth_at(intrinsics, T_task_cam, pixels).reshape(band.shape)
        return image

    def depth_at(self, intrinsics: Intrinsics, T_task_cam: Array, pixels: NDArray[np.int64]) -> NDArray[np.float32]:
        """Depth [m] of some pixels (N, 2), given as (column, row); 0 where nothing is in range. Shape (N,)."""
        t = self.cast(*camera_rays(intrinsics, T_task_cam, pixels))
        seen = np.isfinite(t) & (t >= NEAR) & (t <= FAR)
        return np.where(seen, t, np.float32(0.0)).astype(np.float32)

    def cast(self, origins: Array, directions: Array) -> NDArray[np.float32]:
        """First hit of each ray in units of its direction's length, inf without one. Shapes (N, 3), (N, 3) -> (N,)."""
        rays = np.concatenate([origins, directions], axis=1).astype(np.float32)
        hit: NDArray[np.float32] = self._scene.cast_rays(self._tensor(rays), nthreads=1)["t_hit"].numpy()
        return hit


def camera_rays(intrinsics: Intrinsics, T_task_cam: Array, pixels: NDArray[np.int64]) -> tuple[Array, Array]:
    """Origins and directions (N, 3) of pixels (N, 2) (column, row); directions have depth 1 along the optical axis."""
    x = (pixels[:, 0] - intrinsics.cx) / intrinsics.fx
    y = (pixels[:, 1] - intrinsics.cy) / intrinsics.fy
    directions = np.stack([x, y, np.ones(len(x))], axis=1) @ T_task_cam[:3, :3].T
    return np.broadcast_to(T_task_cam[:3, 3], directions.shape), directions


def project(intrinsics: Intrinsics, T_task_cam: Array, points: Array) -> tuple[NDArray[np.int64], Array]:
    """Nearest pixels (N, 2) (column, row), maybe outside the image, and depths (N,) [m] of task points (N, 3)."""
    T_cam_task = invert(T_task_cam)
    p = points @ T_cam_task[:3, :3].T + T_cam_task[:3, 3]
    u = p[:, 0] / p[:, 2] * intrinsics.fx + intrinsics.cx
    v = p[:, 1] / p[:, 2] * intrinsics.fy + intrinsics.cy
    return np.floor(np.stack([u, v], axis=1) + 0.5).astype(np.int64), p[:, 2]


def _table(height: float) -> Mesh:
    c, h = WORKSPACE_SIZE / 2, TABLE_HALF_SIZE
    corners = [[c - h, c - h, height], [c + h, c - h, height], [c + h, c + h, height], [c - h, c + h, height]]
    return Mesh(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int64))
