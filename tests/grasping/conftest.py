"""A small scene seen by one camera, and networks with random weights."""

import numpy as np
import pytest
import torch

from evg_app.geometry import camera_on_sphere, invert, transform_points
from evg_app.nets.registry import build
from evg_app.perception.tsdf import fuse_depth
from evg_app.types import Intrinsics

CAMERA = Intrinsics(424, 240, 213.339, 213.339, 213.6, 117.2)
T_CAM_TASK = invert(camera_on_sphere([0.15, 0.15, 0.1], 0.6, np.deg2rad(50), np.deg2rad(-70)))
BALLS = (((0.10, 0.09, 0.075), 0.025), ((0.20, 0.14, 0.08), 0.03), ((0.12, 0.21, 0.07), 0.02))
"""Centre and radius [m] of balls lying on the table of the scene."""


def render_balls(balls):
    """Depth [m] of a table at z = 0.05 m with balls on it, by ray intersection. Shape (240, 424)."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    d = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    T_task_cam = invert(T_CAM_TASK)
    down = (d @ T_task_cam[:3, :3].T)[..., 2]
    depth = np.where(down < -1e-6, (0.05 - T_task_cam[2, 3]) / down, 1.9)
    for centre, radius in balls:
        c = transform_points(T_CAM_TASK, centre)
        a, b = (d * d).sum(-1), d @ c
        root = b * b - a * (c @ c - radius**2)
        depth = np.where(root > 0, np.minimum(depth, (b - np.sqrt(np.maximum(root, 0))) / a), depth)
    return depth.astype(np.float32)


@pytest.fixture(scope="session")
def grid():
    """TSDF of three balls on the table."""
    return fuse_depth(render_balls(BALLS), CAMERA, T_CAM_TASK)


@pytest.fixture(scope="session")
def table_only():
    """TSDF of the bare table."""
    return fuse_depth(render_balls(()), CAMERA, T_CAM_TASK)


@pytest.fixture(scope="session")
def networks():
    """Random EquiIGD and EquiGIGA whose predicted widths fit the gripper, so that grasps come out."""
    nets = {}
    with torch.random.fork_rng():
        torch.manual_seed(3)
        for name in ("equiigd", "equigiga"):
            nets[name] = build(name).eval()
            with torch.no_grad():
                for key, parameter in nets[name].width_head.out.named_parameters():
                    parameter.mul_(0.05).add_(0.14 if "bias" in key else 0.0)
    return nets
