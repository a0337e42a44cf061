"""One pass as objects of a viser server: the only file that knows how viser is told what to show in 3D."""

from typing import Any

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.geometry import Array, to_quaternion
from evg_app.viewer.arm import ArmMeshes
from evg_app.viewer.colors import CHOSEN, Bytes
from evg_app.viewer.drawing import Drawing

ARM_COLOR = (215, 215, 220)
ARM_OPACITY = 0.55
"""So that the grasp inside the hand is seen."""
OBSTACLE_COLOR = (150, 150, 160)
MAX_PATH_POINTS = 200
"""Of the drawn tool path."""
EMPTY = np.zeros((0, 3))
LAYERS = ("arm", "cloud", "tsdf", "candidates", "chosen", "path", "workspace", "obstacles")
"""What can be switched off."""


class Scene:
    """Draws into a viser server.

    Args:
        server: a `viser.ViserServer`.
        robot: whose arm and declared obstacles are drawn.
    """

    def __init__(self, server: Any, robot: RobotConfig) -> None:
        self._server, self._arm = server, ArmMeshes(robot)
        self._shown = dict.fromkeys(LAYERS, True)
        self._drawn: Drawing | None = None
        server.scene.set_up_direction("+z")
        server.initial_camera.position = (1.02, -0.32, 0.5)
        server.initial_camera.look_at = (0.45, 0.06, 0.06)
        server.scene.add_grid("/grid", width=2.0, height=2.0, cell_size=0.1)
        with server.atomic():
            server.scene.add_frame("/arm", show_axes=False)
            server.scene.add_frame("/obstacles", show_axes=False)
            self._links = [
                server.scene.add_mesh_simple(
                    f"/arm/{name}", vertices, faces, color=ARM_COLOR, opacity=ARM_OPACITY, flat_shading=True
                )
                for name, (vertices, faces) in zip(self._arm.names, self._arm.meshes, strict=True)
            ]
            for k, box in enumerate(robot.obstacles):
                shape = box.box()
                server.scene.add_box(f"/obstacles/{k}", OBSTACLE_COLOR, shape.size, position=shape.center, opacity=0.4)
        self.move_arm(np.asarray(robot.home_q_rad))

    def show(self, drawn: Drawing, by_score: bool) -> None:
        """Draw a pass; what was there before goes. `by_score` colours candidates by score instead of by verdict."""
        self._drawn = drawn
        with self._server.atomic():
            self._cloud("/cloud", drawn.cloud, drawn.cloud_colors, 0.0025)
            self._cloud("/tsdf", drawn.voxels, drawn.voxel_colors, 0.005)
            self._segments("/workspace", drawn.workspace, _one(drawn.workspace, (90, 90, 100)), 1.0)
            self._segments("/chosen", drawn.chosen, _one(drawn.chosen, CHOSEN), 6.0)
            self._path(drawn.path)
            self.recolor(by_score)
        if drawn.q is not None or len(drawn.path):
            self.move_along(1.0 if not len(drawn.path) else drawn.grasp_at / max(len(drawn.path) - 1, 1))

    def recolor(self, by_score: bool) -> None:
        """Colour the candidates by score, or by verdict."""
        if self._drawn is not None:
            colors = self._drawn.by_score if by_score else self._drawn.by_verdict
            self._segments("/candidates", self._drawn.candidates, colors, 2.0)

    def move_along(self, share: float) -> None:
        """Put the arm at a share of the planned path, 0 at its beginning, or where it stood when there is none."""
        if self._drawn is None:
            return
        if len(self._drawn.path):
            last = len(self._drawn.path) - 1
            self.move_arm(self._drawn.path[round(min(max(share, 0.0), 1.0) * last)])
        elif self._drawn.q is not None:
            self.move_arm(self._drawn.q)

    def move_arm(self, q: Array) -> None:
        """Put the arm at q [rad], shape (J,)."""
        with self._server.atomic():
            for link, T in zip(self._links, self._arm.poses(q), strict=True):
                x, y, z, w = to_quaternion(T)
                link.wxyz, link.position = (w, x, y, z), T[:3, 3]

    def switch(self, layer: str, shown: bool) -> None:
        """Show or hide one of `LAYERS`."""
        self._shown[layer] = shown
        handle = self._server.scene.get_handle_by_name(f"/{layer}")
        if handle is not None:
            handle.visible = shown

    def _cloud(self, name: str, points: Array, colors: Bytes, size: float) -> None:
        """Draw points (N, 3) [m] of a size [m]."""
        self._server.scene.add_point_cloud(
            name,
            points.astype(np.float32),
            colors,
            point_size=size,
            point_shape="circle",
            precision="float32",
            visible=self._shown[name[1:]],
        )

    def _segments(self, name: str, lines: Array, colors: Bytes, pixels: float) -> None:
        """Draw lines (S, 2, 3) [m]."""
        self._server.scene.add_line_segments(
            name,
            lines.astype(np.float32),
            colors,
            thickness=pixels,
            thickness_units="screen",
            visible=self._shown[name[1:]],
        )

    def _path(self, path: Array) -> None:
        """Draw where the hand goes."""
        step = max(len(path) // MAX_PATH_POINTS, 1)
        points = self._arm.tool_path(path[::step]) if len(path) else EMPTY
        lines = np.stack([points[:-1], points[1:]], axis=1) if len(points) > 1 else np.zeros((0, 2, 3))
        self._segments("/path", lines, _one(lines, CHOSEN), 3.0)


def _one(lines: Array, color: tuple[int, int, int]) -> Bytes:
    """The same colour for every end. Shapes (S, 2, 3) -> uint8 (S, 2, 3)."""
    return np.broadcast_to(np.array(color, dtype=np.uint8), lines.shape).copy()
