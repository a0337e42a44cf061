"""Grasp candidates to label: from contacts, along normals, and near grasps that are known to be good."""

import numpy as np

from evg_app.geometry import TABLE_HEIGHT, Array, make
from evg_app.learning.gripper import PAD_Z, finger_points
from evg_app.learning.solids import SceneSolids
from evg_app.learning.surface import SurfacePoints

ANGLES = 12
"""Approach directions about a contact normal (spec §4.5)."""
TILT = 0.2
"""Largest standard deviation of the closing axis about the contact normal [rad]; drawn from 0 to this."""
TABLE_GAP = 0.0045
"""Most candidates with finger tips lower than this above the table are pulled back to it [m] (spec §4.5.5)."""
MAX_RETREAT = 0.014
"""How far they are pulled back along the approach at most [m]."""
RETREAT_SHARE = 0.85
"""Share of the low candidates that are pulled back; the others stay as negatives near the table."""
MAX_RISE = 0.26
"""Largest upward component of an approach direction (spec §4.5: at least 75 degrees from straight up)."""
REACH = 0.09
"""How far behind a contact the other side of the object is looked for [m]."""
BOUNDS = (0.015, 0.285)
"""Allowed grasp positions in x and y [m]."""
_TIPS = np.concatenate([finger_points(+1), finger_points(-1)])
PERTURB_POSITION, PERTURB_ANGLE = 0.010, 0.35
"""Standard deviations of hard samples around positives [m, rad]."""


def from_contacts(scene: SceneSolids, points: SurfacePoints, rng: np.random.Generator) -> Array:
    """Grasps with one finger near each surface point (N,), one random angle of each of 12 sectors. Shape (M, 4, 4)."""
    n = len(points.position)
    y = _unit(points.normal + TILT * rng.random((n, 1)) * rng.normal(size=(n, 3)))
    sector = rng.integers(ANGLES, size=n)
    angle = (sector + rng.random(n)) * (2 * np.pi / ANGLES)
    side = _unit(np.cross(y, _least_aligned(y)))
    z = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(y, side)
    half = _thickness(scene, points, y) / 2 + rng.normal(scale=0.004, size=n)
    along = rng.uniform(PAD_Z[0] + 0.001, PAD_Z[1] - 0.001, size=n)
    t = points.position - np.clip(half, 0.0, 0.039)[:, None] * y - along[:, None] * z
    return _plausible(_above_table(_poses(y, z, t), rng))


def along_normals(points: SurfacePoints, rng: np.random.Generator) -> Array:
    """Grasps that come in against the surface normal, any yaw, finger tips -5 to 45 mm deep. Shape (M, 4, 4)."""
    n = len(points.position)
    z = _unit(-points.normal + rng.normal(scale=0.2, size=(n, 3)))
    angle = rng.uniform(0, 2 * np.pi, size=n)
    side = _unit(np.cross(z, _least_aligned(z)))
    y = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(z, side)
    t = points.position - (PAD_Z[1] - rng.uniform(-0.005, 0.045, size=n))[:, None] * z
    return _plausible(_above_table(_poses(y, z, t), rng))


def perturbed(T_task_grasp: Array, count: int, rng: np.random.Generator) -> Array:
    """`count` poses near random ones of `T_task_grasp` (N, 4, 4): 1 cm and 0.35 rad standard deviation."""
    if len(T_task_grasp) == 0:
        return np.zeros((0, 4, 4))
    base = T_task_grasp[rng.integers(len(T_task_grasp), size=count)]
    R = base[:, :3, :3] @ _exponential(rng.normal(scale=PERTURB_ANGLE, size=(count, 3)))
    t = base[:, :3, 3] + rng.normal(scale=PERTURB_POSITION, size=(count, 3))
    return _plausible(make(R, t))


def turned(T_task_grasp: Array, count: int, rng: np.random.Generator) -> Array:
    """`count` of the poses (N, 4, 4) turned about their approach by 45, 90 or 135 degrees (spec §3.1 (a))."""
    if len(T_task_grasp) == 0:
        return np.zeros((0, 4, 4))
    base = T_task_grasp[rng.integers(len(T_task_grasp), size=count)]
    angle = rng.choice([np.pi / 4, np.pi / 2, 3 * np.pi / 4], size=count)
    return _plausible(make(base[:, :3, :3] @ _exponential(angle[:, None] * [[0.0, 0.0, 1.0]]), base[:, :3, 3]))


def _thickness(scene: SceneSolids, points: SurfacePoints, y: Array) -> Array:
    """Extent of the object behind each contact along -y [m]; 4 cm where another object is in the way."""
    hits = scene.cast(points.position - REACH * y, y)
    own = (hits.owner == points.owner) & (hits.distance < REACH)
    return np.where(own, REACH - hits.distance, 0.04)


def _above_table(T: Array, rng: np.random.Generator) -> Array:
    """Pull most poses (N, 4, 4) whose finger tips are too low back along their approach, as far as that helps."""
    lowest = (_TIPS @ np.swapaxes(T[:, :3, :3], 1, 2))[:, :, 2].min(axis=1) + T[:, 2, 3]
    z = T[:, :3, 2]
    retreat = (TABLE_HEIGHT + TABLE_GAP - lowest) / np.maximum(-z[:, 2], 0.2)
    retreat = np.clip(retreat, 0.0, MAX_RETREAT) * (rng.random(len(T)) < RETREAT_SHARE)
    moved = T.copy()
    moved[:, :3, 3] -= retreat[:, None] * z
    return moved


def _plausible(T: Array) -> Array:
    """The poses inside the workspace that do not come from below."""
    t = T[:, :3, 3]
    inside = ((t[:, :2] > BOUNDS[0]) & (t[:, :2] < BOUNDS[1])).all(axis=1) & (t[:, 2] > 0.02) & (t[:, 2] < 0.298)
    return T[inside & (T[:, 2, 2] < MAX_RISE)]


def _poses(y: Array, z: Array, t: Array) -> Array:
    """Poses from unit closing axes, unit approaches (made orthogonal to them) and positions, each (N, 3)."""
    z = _unit(z - (z * y).sum(axis=1, keepdims=True) * y)
    return make(np.stack([np.cross(y, z), y, z], axis=2), t)


def _unit(v: Array) -> Array:
    unit: Array = v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)
    return unit


def _least_aligned(v: Array) -> Array:
    """For each vector (N, 3) the coordinate axis that it is least aligned with."""
    axis: Array = np.eye(3)[np.abs(v).argmin(axis=1)]
    return axis


def _exponential(w: Array) -> Array:
    """Rotation matrices of rotation vectors (N, 3) [rad]."""
    angle = np.linalg.norm(w, axis=1)[:, None, None]
    axis = w / np.maximum(angle[:, :, 0], 1e-12)
    K = np.zeros((len(w), 3, 3))
    K[:, 2, 1], K[:, 0, 2], K[:, 1, 0] = axis.T
    K = K - np.swapaxes(K, 1, 2)
    R: Array = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)
    return R
