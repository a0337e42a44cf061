"""The stand-in's truth: where camera and board really are, and how the arm really differs from its encoders."""

from dataclasses import dataclass, replace

import numpy as np

from evg_app.config.calibration import MODES, Mode
from evg_app.errors import BadInput
from evg_app.geometry import WORKSPACE_SIZE, Array, camera_on_sphere, invert, make, transform_points
from evg_app.handeye.boards import Board
from evg_app.handeye.poses import Reach, first_motions, hand_pose, visible
from evg_app.handeye.refine import corrected
from evg_app.handeye.rigid import exp
from evg_app.types import Intrinsics

REPEAT_M, REPEAT_RAD = 1e-4, 2e-4
"""Repeatability of the arm: every stop is off by this much along and about each axis (standard deviations)."""
TCP_M, TCP_RAD = 2e-3, 5e-3
"""Constant error of the hand in the arm's model (standard deviations of each axis)."""
ENCODER_RAD = 3e-4
"""Constant offset of each joint (standard deviation): an arm's absolute error is larger than its repeatability."""
PRINT = 1e-3
"""Relative error of the print's size (standard deviation)."""
FOCAL, CENTRE_PX = 1e-3, 0.7
"""What the camera says about its lens is off by this: focal length (relative), principal point (std. deviations)."""
TRIES = 400
"""Labs that are drawn until one has room."""
ROOM = 6
"""Of the 8 first motions, how many must be reachable from where the user put the arm."""


@dataclass(frozen=True)
class Truth:
    """What only the stand-in and the judge know.

    Attributes:
        mode: where the camera really is.
        X: camera in the base, or in the real hand (eye-in-hand). Shape (4, 4).
        Z: board in the real hand, or in the base (eye-in-hand). Shape (4, 4).
        T_hand_real: the real hand in the hand of the arm's model. Shape (4, 4).
        encoder: joint offsets [rad]. Shape (J,).
        print_scale: true over nominal size of the board.
        intrinsics: of the lens.
        told: what the camera says about its lens.
        q_start: where the user has put the arm: the board is in view. Shape (J,).
    """

    mode: Mode
    X: Array
    Z: Array
    T_hand_real: Array
    encoder: Array
    print_scale: float
    intrinsics: Intrinsics
    told: Intrinsics
    q_start: Array

    @property
    def T_parent_cam(self) -> Array:
        """What the calibration should find: seen from the base, or from the hand of the arm's model. Shape (4, 4)."""
        return self.X if self.mode == "eye-to-hand" else self.T_hand_real @ self.X

    def T_cam_board(self, T_base_real: Array) -> Array:
        """What the camera sees when the real hand is at `T_base_real` (4, 4). Shape (4, 4)."""
        return invert(self.X) @ (T_base_real if self.mode == "eye-to-hand" else invert(T_base_real)) @ self.Z


def draw_truth(mode: Mode, seed: int, reach: Reach, board: Board, nominal: Intrinsics) -> Truth:
    """A random lab in which the arm can show the board to the camera.

    Raises:
        BadInput: none was found; the robot's limits or its boxes leave no room.
    """
    rng = np.random.default_rng([seed, MODES.index(mode)])
    draw = _to_hand if mode == "eye-to-hand" else _in_hand
    T_hand_real = make(exp(rng.normal(0, TCP_RAD, 3)), rng.normal(0, TCP_M, 3))
    encoder = rng.normal(0, ENCODER_RAD, len(reach.motion.robot.joints))
    lens = replace(nominal, distortion=_lens(rng))
    print_scale = 1.0 + float(rng.normal(0, PRINT))
    told = corrected(lens, rng.normal(0, (FOCAL, CENTRE_PX, CENTRE_PX)))
    for _ in range(TRIES):
        X, Z = draw(rng, reach.motion.robot.T_base_task.matrix(), board)
        q = _start(rng, mode, X, Z, reach, board, lens)
        if q is not None:
            return Truth(mode, X, Z, T_hand_real, encoder, print_scale, lens, told, q)
    raise BadInput(f"no place for camera and board was found in which '{reach.motion.robot.name}' can show the board")


def _lens(rng: np.random.Generator) -> tuple[float, ...]:
    """Random distortion k1, k2, p1, p2, k3."""
    k1, k2 = rng.uniform(-0.10, 0.10), rng.uniform(-0.05, 0.05)
    return (float(k1), float(k2), float(rng.normal(0, 5e-4)), float(rng.normal(0, 5e-4)), 0.0)


def _to_hand(rng: np.random.Generator, T_base_task: Array, board: Board) -> tuple[Array, Array]:
    """A camera beside the table, and a board held like a flag below the hand."""
    middle = np.full(3, WORKSPACE_SIZE / 2) + rng.uniform(-0.04, 0.04, 3)
    azimuth = rng.uniform(-np.pi, np.pi)
    view = camera_on_sphere(middle, rng.uniform(0.60, 0.90), rng.uniform(0.5, 1.15), azimuth)
    X = T_base_task @ view @ make(exp(np.array([0, 0, rng.normal(0, 0.2)])), np.zeros(3))
    around = exp(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
    # board z (into the board) perpendicular to the hand's z, board y along the hand's z
    flag = around @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) @ exp(rng.normal(0, 0.12, 3))
    centre = np.array([0.0, 0.0, 0.10 + board.model.size[1] / 2]) + rng.normal(0, 0.01, 3)
    return X, make(flag, centre - flag @ board.center)


def _in_hand(rng: np.random.Generator, T_base_task: Array, board: Board) -> tuple[Array, Array]:
    """A camera beside the gripper, and a board lying in the workspace."""
    azimuth, off = rng.uniform(-np.pi, np.pi), rng.uniform(0.05, 0.09)
    tilt = rng.uniform(-0.1, 0.35)
    outward = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    lean = exp(tilt * np.cross(outward, [0.0, 0.0, 1.0])) @ exp(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
    X = make(exp(rng.normal(0, 0.05, 3)) @ lean, outward * off + np.array([0, 0, rng.uniform(0.0, 0.06)]))
    spot = transform_points(T_base_task, np.array([0.15, 0.15, 0.052]) + np.append(rng.uniform(-0.05, 0.05, 2), 0.0))
    lying = exp(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)])) @ np.diag([1.0, -1.0, -1.0])
    R = exp(rng.normal(0, 0.02, 3)) @ lying
    return X, make(R, spot - R @ board.center)


def _start(
    rng: np.random.Generator, mode: Mode, X: Array, Z: Array, reach: Reach, board: Board, K: Intrinsics
) -> Array | None:
    """A configuration in which the board is seen well, as a user would jog the arm to."""
    for _ in range(4):
        z = rng.uniform(0.40, 0.60)
        u, v = K.cx + rng.uniform(-80, 80), K.cy + rng.uniform(-30, 30)
        roll = exp(np.array([0, 0, rng.uniform(-np.pi, np.pi)]))
        R = exp(np.append(rng.normal(0, 0.2, 2), 0.0)) @ roll
        T = make(R, z * np.array([(u - K.cx) / K.fx, (v - K.cy) / K.fy, 1.0]) - R @ board.center)
        hand = hand_pose(mode, X, Z, T)
        q = reach.configuration(hand, reach.motion.home_q)
        if q is None or not visible(board, K, T):
            continue
        if mode == "eye-to-hand" and not reach.clear(q, transform_points(hand @ Z, board.outline)):
            continue
        around = [choices[0] for choices in first_motions(hand)]
        if sum(reach.configuration(pose, q) is not None for pose in around) >= ROOM:
            return q
    return None
