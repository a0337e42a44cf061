"""The judge: adds the true errors to a result. It alone sees both the result and the truth."""

from typing import Any

import numpy as np

from evg_app.geometry import Array, invert, rotation_angle, transform_points
from evg_app.handeye.rigid import cube_points, displacement
from evg_app.handeye.standin.world import Truth
from evg_app.motion.kinematics import Kinematics


def true_errors(truth: Truth, kinematics: Kinematics, T_parent_cam: Array) -> tuple[float, float]:
    """RMS displacement over the workspace cube [mm] (eye-in-hand: seen from the first pose), and angle [deg]."""
    cube = cube_points(kinematics.robot.T_base_task.matrix())
    if truth.mode == "eye-in-hand":
        cube = transform_points(invert(kinematics.fk_hand(truth.q_start)), cube)
    mm = 1000 * displacement(truth.T_parent_cam, T_parent_cam, cube)
    return mm, float(np.rad2deg(rotation_angle(truth.T_parent_cam, T_parent_cam)))


def judged(facts: dict[str, Any], truth: Truth, kinematics: Kinematics) -> dict[str, Any]:
    """The facts of a result with `true_mm` and `true_deg`, None without a transform."""
    T = facts.get("T_parent_cam")
    mm, deg = (None, None) if T is None else true_errors(truth, kinematics, np.array(T))
    return {**facts, "true_mm": mm, "true_deg": deg}
