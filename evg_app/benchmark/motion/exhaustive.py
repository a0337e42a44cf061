"""Exhaustive search for ways to a grasp: every 2 degrees of the free joint, both flips, and numerical solutions.

Nothing here is quick or clever: it says what could have been found. A grasp is reachable when some configuration at
the grasp is inside the limits and free of collision, and straight approach and lift with the same free joint are too.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evg_app.config.models import RobotConfig
from evg_app.geometry import T_GRASP_FLIPPED, Array
from evg_app.motion.collision import ArmChecker
from evg_app.motion.franka_ik import BRANCHES
from evg_app.motion.kinematics import hand_of_grasp
from evg_app.motion.legs import MAX_JUMP, approach_poses, lift_poses
from evg_app.motion.scene import Scene

STEP = np.deg2rad(2.0)
"""Step of the free joint q7 [rad]."""
ITERATIONS = 60
"""Steps of the numerical inverse kinematics."""
DAMPING = 1e-3
"""Of the least squares [m^2 and rad^2]."""
MAX_STEP = 0.5
"""Longest step of a joint in one iteration [rad]."""
CLOSE = (1e-4, np.deg2rad(0.1))
"""A numerical solution reproduces the pose to this [m, rad]."""
SAME = 1e-2
"""A numerical and a closed-form solution with the same q7 are the same within this [rad]."""
BATCH = 8
"""Legs checked at a time."""

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Reach:
    """What the exhaustive search found out about one grasp.

    Attributes:
        solutions: configurations at the grasp inside the limits, both flips.
        free: of them, free of collision of the arm with itself and the scene.
        straight: whether one of these keeps its approach and lift solvable, smooth, inside the limits and free.
        numerical: solutions that the random starts converged to, inside the limits.
        missed: of these, how many the closed form does not give for the same q7.
    """

    solutions: int
    free: int
    straight: bool
    numerical: int
    missed: int


class ExhaustiveSearch:
    """Asks the planner's kinematics and collision check, but chooses nothing."""

    def __init__(self, robot: RobotConfig, checker: ArmChecker, seeds: int) -> None:
        """`seeds` random starts of the numerical inverse kinematics for each flip."""
        self._robot, self._checker, self._seeds = robot, checker, seeds
        self._kinematics = checker.kinematics
        self._grid = np.arange(self._kinematics.lower[6], self._kinematics.upper[6] + 1e-9, STEP)

    def reach(self, T_base_grasp: Array, scene: Scene, rng: np.random.Generator) -> Reach:
        """Search for ways to a grasp (4, 4) in a scene."""
        counts = np.zeros(4, dtype=np.int64)
        straight = False
        for T in (T_base_grasp, T_base_grasp @ T_GRASP_FLIPPED):
            T_base_hand = hand_of_grasp(self._robot, T)
            numerical = self.numerical(T_base_hand, rng)
            q7 = np.concatenate([self._grid, numerical[:, 6]])
            found = self._kinematics.closed_form(np.broadcast_to(T_base_hand, (len(q7), 4, 4)), q7)
            rows, branch = np.nonzero(self._kinematics.inside_limits(found))
            q = found[rows, branch]
            free = self._free(q, scene)
            counts += [len(q), int(free.sum()), len(numerical), _missed(numerical, found[len(self._grid) :])]
            straight = straight or any(self._legs(T, q[free], branch[free], scene))
        return Reach(int(counts[0]), int(counts[1]), straight, int(counts[2]), int(counts[3]))

    def numerical(self, T_base_hand: Array, rng: np.random.Generator) -> Array:
        """Configurations (K, 7) inside the limits that damped least squares reaches from random starts."""
        kinematics = self._kinematics
        q = rng.uniform(kinematics.lower, kinematics.upper, (self._seeds, 7))
        for _ in range(ITERATIONS):
            error, J = _error(kinematics.frames(q), kinematics.geometry.T_7_hand, T_base_hand)
            Jt = np.swapaxes(J, 1, 2)
            step = (Jt @ np.linalg.solve(J @ Jt + DAMPING**2 * np.eye(6), error[:, :, None]))[:, :, 0]
            longest = np.abs(step).max(axis=1, keepdims=True)
            q = q + step * np.minimum(1.0, MAX_STEP / np.maximum(longest, 1e-12))
        q = kinematics.wrap(q)
        error, _ = _error(kinematics.frames(q), kinematics.geometry.T_7_hand, T_base_hand)
        good = np.linalg.norm(error[:, :3], axis=1) < CLOSE[0]
        good &= np.linalg.norm(error[:, 3:], axis=1) < CLOSE[1]
        reached: Array = q[good & kinematics.inside_limits(q)]
        return reached

    def _free(self, q: Array, scene: Scene) -> Flags:
        """Which configurations (K, 7) touch neither themselves nor the scene; the gripper is the grasp's affair."""
        free = ~self._checker.hits_scene(q, scene, gripper=False)
        for k in np.flatnonzero(free):
            free[k] = not self._checker.self_collision.collides(q[k])
        return free

    def _legs(self, T: Array, q: Array, branch: NDArray[np.int64], scene: Scene) -> Iterator[bool]:
        """For one configuration after another, whether approach and lift with its q7 and branch are possible."""
        poses = hand_of_grasp(self._robot, np.concatenate([approach_poses(self._robot, T), lift_poses(self._robot, T)]))
        for begin in range(0, len(q), BATCH):
            rows = slice(begin, begin + BATCH)
            legs = self._kinematics.follow(poses, q[rows, 6], branch[rows])
            possible = self._kinematics.inside_limits(legs).all(axis=1)
            possible &= np.abs(np.diff(np.nan_to_num(legs, nan=1e3), axis=1)).max(axis=(1, 2)) < MAX_JUMP
            for leg in legs[possible]:
                yield bool(self._free(leg, scene).all())


def _missed(numerical: Array, closed: Array) -> int:
    """How many numerical solutions (K, 7) are none of the closed form's for their q7 (K, 8, 7)."""
    if len(numerical) == 0:
        return 0
    gap = np.abs(np.nan_to_num(closed, nan=1e3) - numerical[:, None])
    gap = np.abs(np.where(gap > np.pi, gap - 2 * np.pi, gap)).max(axis=2)
    assert gap.shape == (len(numerical), BRANCHES)
    return int((gap.min(axis=1) > SAME).sum())


def _error(frames: Array, T_7_hand: Array, T_wanted: Array) -> tuple[Array, Array]:
    """Pose error (N, 6) [m, rad] of hands to a wanted pose, and the Jacobian (N, 6, 7); `frames` is (N, 8, 4, 4)."""
    T = frames[:, 7] @ T_7_hand
    R_error = T_wanted[:3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)
    sine = np.stack(
        [
            R_error[:, 2, 1] - R_error[:, 1, 2],
            R_error[:, 0, 2] - R_error[:, 2, 0],
            R_error[:, 1, 0] - R_error[:, 0, 1],
        ],
        axis=1,
    )
    length = np.linalg.norm(sine, axis=1)
    angle = np.arctan2(length, np.trace(R_error, axis1=1, axis2=2) - 1.0)
    turn = sine * (angle / np.maximum(length, 1e-9))[:, None]
    error = np.concatenate([T_wanted[:3, 3] - T[:, :3, 3], turn], axis=1)
    axis, origin = frames[:, 1:, :3, 2], frames[:, 1:, :3, 3]
    linear = np.cross(axis, T[:, None, :3, 3] - origin)
    return error, np.swapaxes(np.concatenate([linear, axis], axis=2), 1, 2)
