"""One robot and planner for all motion tests, and scenes of boxes on the table with an exact signed distance."""

import numpy as np
import pytest

from evg_app.config.files import load_robot
from evg_app.geometry import GRID_SIZE, TABLE_HEIGHT, VOXEL_SIZE, rotation_about
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.scene import SceneView
from evg_app.types import CollisionVolume, Grasps, TsdfGrid

VOLUME_ORIGIN = np.array([0.1, -0.4, -0.15])
VOLUME_VOXEL = 0.0125
VOLUME_SIZE = 64
TRUNCATION = 0.03


def _centers(n, voxel):
    return (np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1) + 0.5) * voxel


def _distance(p, boxes):
    d = p[..., 2] - TABLE_HEIGHT
    for center, half in boxes:
        q = np.abs(p - np.asarray(center)) - np.asarray(half)
        outside = np.sqrt((np.maximum(q, 0) ** 2).sum(-1))
        d = np.minimum(d, outside + np.minimum(q.max(-1), 0))
    return d


@pytest.fixture(scope="session")
def robot():
    return load_robot("panda")


@pytest.fixture(scope="session")
def planner(robot):
    return MotionPlanner(robot)


@pytest.fixture(scope="session")
def make_scene(robot):
    """boxes [(center, half sides)] in the task frame, anywhere -> SceneView."""

    def build(boxes=(), declared=()):
        f = _distance(_centers(GRID_SIZE, VOXEL_SIZE), boxes) / TRUNCATION
        band = (f >= -0.98) & (f < 0.98)
        values = np.where(band, (np.clip(f, -1, 1) + 1) / 2, 0).astype(np.float32)
        in_task = _centers(VOLUME_SIZE, VOLUME_VOXEL) + VOLUME_ORIGIN - robot.T_base_task.matrix()[:3, 3]
        occupied = np.abs(_distance(in_task, boxes)) < VOLUME_VOXEL * 0.6
        volume = CollisionVolume(occupied, np.ones_like(occupied), VOLUME_ORIGIN, VOLUME_VOXEL)
        return SceneView(TsdfGrid(values, f >= -0.98), volume, tuple(declared))

    return build


@pytest.fixture(scope="session")
def top_grasp():
    """Tip position in the task frame, yaw and tilt -> T_task_grasp that points down."""

    def build(tip, yaw=0.0, tilt=0.0):
        T = rotation_about("z", yaw) @ rotation_about("x", np.pi) @ rotation_about("x", tilt)
        T[:3, 3] = np.asarray(tip) - 0.05 * T[:3, 2]
        return T

    return build


@pytest.fixture(scope="session")
def as_grasps():
    def build(*transforms, width=0.04):
        n = len(transforms)
        widths = np.broadcast_to(width, (n,)).astype(float)
        return Grasps(np.stack(transforms), widths, np.linspace(0.9, 0.5, n))

    return build
