"""Simulated pictures (TinyRenderer): the depth camera beside the table, and the spectator of a run."""

from typing import Any

import numpy as np
import pybullet
from numpy.typing import NDArray

from evg_app.config.models import CameraConfig
from evg_app.errors import DeviceTimeout
from evg_app.geometry import Array, invert, look_at
from evg_app.simulation.bullet import Client
from evg_app.simulation.noise import add_noise
from evg_app.simulation.views import draw_view
from evg_app.simulation.world import SimWorld
from evg_app.types import Frame, Intrinsics
from evg_app.unconnected import Unconnected

_OPTICAL_TO_GL = np.diag([1.0, -1.0, -1.0, 1.0])
ROW_OFFSET = 1.0
"""TinyRenderer's picture is one row off; the projection is shifted by it (then it agrees with ray casting to 1 um)."""


def gl_matrices(intrinsics: Intrinsics, T_world_cam: Array, near: float, far: float) -> tuple[list[float], list[float]]:
    """View and projection matrices (column-major, 16 numbers) of an optical camera for PyBullet."""
    w, h = intrinsics.width, intrinsics.height
    cy = intrinsics.cy + ROW_OFFSET
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 2 * intrinsics.fx / w, 2 * intrinsics.fy / h
    projection[0, 2], projection[1, 2] = 1 - 2 * intrinsics.cx / w, 2 * cy / h - 1
    projection[2, 2], projection[2, 3] = -(far + near) / (far - near), -2 * far * near / (far - near)
    projection[3, 2] = -1.0
    view = _OPTICAL_TO_GL @ invert(T_world_cam)
    return view.T.ravel().tolist(), projection.T.ravel().tolist()


def render(
    client: Client, intrinsics: Intrinsics, T_world_cam: Array, near: float, far: float
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Colour (H, W, 3) and exact depth (H, W) [m], 0 where nothing is in range."""
    view, projection = gl_matrices(intrinsics, T_world_cam, near, far)
    shot: Any = client.getCameraImage(
        intrinsics.width,
        intrinsics.height,
        viewMatrix=view,
        projectionMatrix=projection,
        renderer=pybullet.ER_TINY_RENDERER,
        lightDirection=(0.4, -0.6, 1.2),
        shadow=0,
        flags=pybullet.ER_NO_SEGMENTATION_MASK,
    )
    shape = (intrinsics.height, intrinsics.width)
    color = np.asarray(shot[2], dtype=np.uint8).reshape(*shape, 4)[..., :3].copy()
    buffer = np.asarray(shot[3], dtype=np.float64).reshape(shape)
    depth = far * near / (far - (far - near) * buffer)
    return color, np.where((depth < 0.999 * far) & (depth >= near), depth, 0.0).astype(np.float32)


class SimulatedCamera(Unconnected):
    """A `Camera` that stands beside the table (eye to hand). Waiting for a frame steps the world."""

    def __init__(self, world: SimWorld, config: CameraConfig, seed: int = 0) -> None:
        self._world, self._config = world, config
        self._intrinsics = config.simulated_intrinsics()
        self._seed, self._rng = seed, np.random.default_rng(seed)
        self._number = 0
        self.T_base_cam = world.T_base_task @ draw_view(world.world_config.view, self._rng)
        """Where the camera stands. Shape (4, 4)."""
        world.on_reset.append(self._renew)

    def _renew(self) -> None:
        """A new round begins: its noise depends on its seed alone."""
        self._rng = np.random.default_rng([self._seed, self._world.seed])

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the depth stream."""
        return self._intrinsics

    @property
    def frame_id(self) -> str:
        """Name of the depth optical frame."""
        return self._config.frame_id

    def capture(self, *, after: float, timeout: float) -> Frame:
        """A frame exposed now, or at `after` [s] if that is later.

        Raises:
            DeviceTimeout: `after` is more than `timeout` [s] away.
        """
        if after > self._world.time + timeout:
            raise DeviceTimeout("a simulated frame", timeout, "It was asked for a time too far ahead.")
        self._world.step_until(after)
        color, depth = render(
            self._world.client, self._intrinsics, self.T_base_cam, self._config.near_m, self._config.far_m
        )
        noisy = add_noise(self._world.world_config.noise, depth, self._rng)
        raw = np.clip(np.rint(noisy / self._config.depth_scale_m), 0, np.iinfo(np.uint16).max).astype(np.uint16)
        self._number += 1
        return Frame(
            depth=raw,
            depth_scale=self._config.depth_scale_m,
            intrinsics=self._intrinsics,
            stamp=self._world.time,
            frame_id=self.frame_id,
            color=color,
            number=self._number,
        )


def spectate(world: SimWorld, width: int = 320, height: int = 240) -> NDArray[np.uint8]:
    """A picture of the whole scene for the run's film. RGB, shape (height, width, 3)."""
    middle = world.T_base_task[:3, 3] + np.array([0.0, 0.2, 0.30])
    T_world_cam = look_at(middle + np.array([0.80, -0.60, 0.55]), middle)
    f = 1.12 * height
    color, _ = render(world.client, Intrinsics(width, height, f, f, width / 2, height / 2), T_world_cam, 0.05, 5.0)
    return color
