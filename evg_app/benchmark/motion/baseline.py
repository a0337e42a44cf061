"""The baseline: straight joint interpolation to the nearest solution, unchecked, as plain pick scripts do."""

from dataclasses import dataclass

import numpy as np

from evg_app.geometry import T_GRASP_FLIPPED, Array
from evg_app.motion.kinematics import Kinematics, hand_of_grasp
from evg_app.motion.path import line
from evg_app.motion.trajectory import time_path
from evg_app.types import Trajectory


@dataclass(frozen=True)
class StraightPick:
    """Two motions of a pick without any check: to the pre-grasp, and to the grasp."""

    reach: Trajectory
    approach: Trajectory


def straight_pick(kinematics: Kinematics, T_base_grasp: Array, q_start: Array) -> StraightPick | None:
    """Straight in joint space to the nearest pre-grasp and from there to the nearest grasp; None without a solution.

    Args:
        kinematics: of the arm.
        T_base_grasp: shape (4, 4); its antipodal twin is taken where it is nearer.
        q_start: where the arm is. Shape (7,).
    """
    robot = kinematics.robot
    ways: list[tuple[Array, Array]] = []
    for T in (T_base_grasp, T_base_grasp @ T_GRASP_FLIPPED):
        before = T.copy()
        before[:3, 3] -= robot.pregrasp_m * T[:3, 2]
        q_before = kinematics.ik(hand_of_grasp(robot, before), q_start)
        q_at = None if q_before is None else kinematics.ik(hand_of_grasp(robot, T), q_before)
        if q_before is not None and q_at is not None:
            ways.append((q_before, q_at))
    if not ways:
        return None
    q_before, q_at = min(ways, key=lambda way: float((np.abs(way[0] - q_start) / kinematics.speed).max()))
    return StraightPick(time_path(line(q_start, q_before), robot), time_path(line(q_before, q_at), robot))
