"""Is a grasp reachable at all? A slow, complete search that the planner's own choice is measured against.

It tries what the planner does not take the time for: the free joint every 2 degrees, every branch of the closed form,
both antipodal flips, and numeric inverse kinematics from hundreds of random seeds.
"""

from dataclasses import dataclass

import numpy as np

from evg_app.geometry import T_GRASP_FLIPPED, Array
from evg_app.motion.candidates import QUICK, THOROUGH, free_at_grasp
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.kinematics import Kinematics, hand_of_grasp
from evg_app.motion.legs import MAX_JUMP, Leg, approach_poses, lift_poses
from evg_app.motion.scene import Scene
from evg_app.motion.track import jacobian, pose_error
from evg_app.types import Verdict

Q7_STEP = np.deg2rad(2.0)
"""Step of the free joint [rad]."""
SEEDS = 500
"""Random seeds of the numeric search for each flip."""
ITERATIONS = 60
"""Steps of the numeric search."""
DAMPING = 1e-4
"""Of the numeric search's least-squares steps."""
LARGEST_STEP = 0.4
"""Of one joint in one iteration [rad]."""
REACHED_M, REACHED_RAD = 1e-4, 1.7e-3
"""The pose counts as reached within 0.1 mm and 0.1 degrees."""


@dataclass(frozen=True)
class Reachability:
    """What a complete search and the planner's own found for one grasp.

    Attributes:
        configuration: the complete search found a configuration at the grasp, inside the joint limits, at which the
            arm touches neither itself nor the scene.
        legs: it also found one from which straight approach and lift stay so.
        found_configuration, found_legs: the same, among what the planner itself looks at.
    """

    configuration: bool
    legs: bool
    found_configuration: bool
    found_legs: bool


def reachability(
    planner: MotionPlanner, scene: Scene, T_base_grasp: Array, q_start: Array, seeds: int = SEEDS
) -> Reachability:
    """Compare the planner's search for one grasp with the complete one. The gripper itself is not checked.

    Args:
        planner: whose search is judged.
        scene: prepared scene.
        T_base_grasp: shape (4, 4).
        q_start: where the arm is. Shape (7,).
        seeds: of the numeric search.
    """
    found_configuration = found_legs = False
    for effort in (QUICK, THOROUGH):
        near = free_at_grasp(planner.robot, planner.checker, scene, T_base_grasp, q_start, effort)
        mine = planner.free_legs(scene, T_base_grasp, q_start, effort)
        found_configuration = found_configuration or not isinstance(near, Verdict)
        found_legs = found_legs or (not isinstance(mine, Verdict) and next(mine, None) is not None)
        if found_legs:
            break
    configuration, legs = found_configuration, found_legs
    for T in (T_base_grasp, T_base_grasp @ T_GRASP_FLIPPED):
        if legs:
            break
        q = _free(planner, scene, every_solution(planner.kinematics, hand_of_grasp(planner.robot, T)))
        legs = _any_straight(planner, scene, T, q)
        if not configuration and len(q) == 0:
            rng = np.random.default_rng(0)
            random = rng.uniform(planner.kinematics.lower, planner.kinematics.upper, (seeds, 7))
            q = _free(planner, scene, numeric_solutions(planner.kinematics, hand_of_grasp(planner.robot, T), random))
        configuration = configuration or len(q) > 0
    return Reachability(configuration, legs, found_configuration, found_legs)


def every_solution(kinematics: Kinematics, T_base_hand: Array) -> Array:
    """Configurations (K, 7) inside the limits for one pose (4, 4): all branches, q7 every `Q7_STEP`."""
    low, high = float(kinematics.lower[6]), float(kinematics.upper[6])
    q7 = np.append(np.arange(low, high, Q7_STEP), high)
    found = kinematics.closed_form(np.broadcast_to(T_base_hand, (len(q7), 4, 4)), q7)
    solutions: Array = found[kinematics.inside_limits(found)]
    return solutions


def numeric_solutions(kinematics: Kinematics, T_base_hand: Array, seeds: Array) -> Array:
    """Configurations (K, 7) inside the limits that damped least squares finds from seeds (S, 7) for one pose (4, 4)."""
    q = seeds.copy()
    for _ in range(ITERATIONS):
        frames = kinematics.frames(q)
        error = pose_error(frames[:, 7] @ kinematics.geometry.T_7_hand, T_base_hand[None])
        J = jacobian(frames, frames[:, 7] @ kinematics.geometry.T_7_hand)
        square = J @ J.transpose(0, 2, 1) + DAMPING * np.eye(6)
        step = (J.transpose(0, 2, 1) @ np.linalg.solve(square, error[..., None]))[..., 0]
        q = np.clip(q + np.clip(step, -LARGEST_STEP, LARGEST_STEP), kinematics.lower, kinematics.upper)
    error = pose_error(kinematics.fk_hand(q), T_base_hand[None])
    reached = np.linalg.norm(error[:, :3], axis=1) < REACHED_M
    reached &= np.linalg.norm(error[:, 3:], axis=1) < REACHED_RAD
    solutions: Array = q[reached]
    return solutions


def _free(planner: MotionPlanner, scene: Scene, q: Array) -> Array:
    """Those of the configurations (K, 7) at which the arm touches neither itself nor the scene."""
    if len(q) == 0:
        return q
    clear = q[~planner.checker.hits_scene(q, scene, gripper=False)]
    keep = [row for row in clear if not planner.checker.self_collision.collides(row)]
    return np.array(keep).reshape(-1, 7)


def _any_straight(planner: MotionPlanner, scene: Scene, T_base_grasp: Array, q: Array) -> bool:
    """Whether approach and lift can be followed without contact from any of the configurations (K, 7) at the grasp."""
    approach, lift = approach_poses(planner.robot, T_base_grasp), lift_poses(planner.robot, T_base_grasp)
    poses = hand_of_grasp(planner.robot, np.concatenate([approach, lift]))
    kinematics, n = planner.kinematics, len(approach)
    for row in q:
        at_grasp = kinematics.closed_form(poses[n : n + 1], row[6:7])[0]
        branch = int(np.nanargmin(np.abs(at_grasp - row).max(axis=1)))
        path = kinematics.follow(poses, row[6:7], np.array([branch]))[0]
        smooth = np.isfinite(path).all() and np.abs(np.diff(path, axis=0)).max() < MAX_JUMP
        if smooth and kinematics.inside_limits(path).all():
            leg = Leg(T_base_grasp, False, path[:n], path[n:], 0.0)
            if planner.leg_is_free(leg, scene):
                return True
    return False
