"""Limits of what was really sent, recomputed from the samples alone and without the planner's own verifier."""

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from evg_app.config.arm import NearEnds
from evg_app.config.models import RobotConfig
from evg_app.config.robot_files import resolve
from evg_app.geometry import Array
from evg_app.types import Trajectory

TOLERANCE = 1e-6
"""Relative excess that is forgiven: the samples are rounded numbers."""
JOIN = 1e-6
"""A motion must begin this close to where the one before it ended [rad]."""
PADDING = 3
"""Samples at rest that are put before and after every motion: the arm stands still there."""


def positions(robot: RobotConfig) -> tuple[Array, Array]:
    """Lowest and highest positions of the joints: the config's, else read from the URDF's text. (J,) [rad] each."""
    if robot.limits.position_rad:
        low, high = np.array(robot.limits.position_rad).T
        return low, high
    found = {}
    for joint in ElementTree.parse(resolve(robot.urdf)).getroot().iter("joint"):
        limit = joint.find("limit")
        if limit is not None:
            found[joint.get("name", "")] = (float(limit.get("lower", "nan")), float(limit.get("upper", "nan")))
    low, high = np.array([found[name] for name in robot.model_joints]).T
    return low, high


def worst_ratios(sent: Sequence[Trajectory], robot: RobotConfig) -> dict[str, float]:
    """Largest share of each limit that the sent samples reach; above 1 + `TOLERANCE` it is broken.

    The motions follow each other with the arm at rest in between (the gripper moves there), so each is joined to
    `PADDING` samples of standstill: a velocity left over at an end shows as acceleration and jerk.

    Args:
        sent: in the order in which they were sent.
        robot: whose limits, velocity, acceleration and jerk times their scale.

    Returns:
        Shares of "position" (from the middle of the range), "velocity" (near joint ends too, where the arm has such
        limits), "acceleration", "jerk", and "join": the largest gap between two motions over `JOIN`.
    """
    low, high = positions(robot)
    m = robot.limits
    allowed = {
        "velocity": np.asarray(m.velocity_rad_s) * m.velocity_scale,
        "acceleration": np.asarray(m.acceleration_rad_s2) * m.acceleration_scale,
        "jerk": np.asarray(m.jerk_rad_s3) * m.jerk_scale,
    }
    worst = dict.fromkeys(("position", *allowed, "join"), 0.0)
    end: Array | None = None
    for motion in sent:
        q = np.asarray(motion.q)
        worst["position"] = max(worst["position"], float(np.abs((2 * q - low - high) / (high - low)).max()))
        rate = np.concatenate([np.repeat(q[:1], PADDING, axis=0), q, np.repeat(q[-1:], PADDING, axis=0)])
        for quantity, limit in allowed.items():
            rate = (rate[1:] - rate[:-1]) / motion.dt
            worst[quantity] = max(worst[quantity], float((np.abs(rate) / limit).max()))
        if m.near_ends is not None:
            worst["velocity"] = max(worst["velocity"], _near_ends(q, motion.dt, m.near_ends))
        if end is not None:
            worst["join"] = max(worst["join"], float(np.abs(q[0] - end).max()) / JOIN)
        end = q[-1]
    return worst


def _near_ends(q: Array, dt: float, ends: NearEnds) -> float:
    """Largest share of the position-dependent velocity limits (whole, without scale) that samples (M, J) reach."""
    speed = np.diff(q, axis=0) / dt
    middle = (q[1:] + q[:-1]) / 2
    gain, offset = np.array(ends.gain), np.array(ends.offset_rad_s)
    worst = 0.0
    for sign, gap in ((1.0, np.array(ends.upper_rad) - middle), (-1.0, middle - np.array(ends.lower_rad))):
        allowed = np.sqrt(gain * np.maximum(gap, 0.0)) - offset
        moving = sign * speed > 1e-9
        share = sign * speed / np.maximum(allowed, 1e-9)
        worst = max(worst, float(np.where(moving, share, 0.0).max()))
    return worst


def broken(ratios: dict[str, float]) -> tuple[str, ...]:
    """Which limits are broken; not-a-number breaks everything."""
    return tuple(name for name, ratio in ratios.items() if not ratio <= 1.0 + TOLERANCE)
