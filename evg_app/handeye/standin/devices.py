"""Arm and camera of the stand-in, behind the usual protocols: the arm is at once where it is sent, nearly."""

from dataclasses import dataclass, field

import numpy as np

from evg_app.geometry import TABLE_HEIGHT, Array, invert, make, translation
from evg_app.handeye.boards import Board
from evg_app.handeye.refine import corrected
from evg_app.handeye.rigid import exp, moved
from evg_app.handeye.standin.picture import BoardPainter, Exposure
from evg_app.handeye.standin.world import REPEAT_M, REPEAT_RAD, Truth
from evg_app.motion.kinematics import Kinematics
from evg_app.types import ArmMode, ArmState, Frame, Intrinsics, MotionResult, Trajectory
from evg_app.unconnected import Unconnected

DEPTH_SCALE = 0.001
DEPTH_FACTOR, DEPTH_NOISE = 0.01, 0.0015
"""Stereo depth: common factor (standard deviation), and noise of each pixel [m]."""
HIDDEN_SHARE = 0.35
"""Share of the pictures in which something hides a part of the board."""


@dataclass(frozen=True)
class Faults:
    """What is deliberately wrong with a session.

    Attributes:
        print_scale: multiplies the true size of the board.
        blur_px: motion blur of every picture [px].
        bump: shift [m] and turn [rad] of the camera, shape (6,), from picture `bump_at` on.
        lens: what the camera says about its lens is off by: log focal length, principal point [px]; (3,).
        wrong_joints: pictures whose joint positions are those of another moment, by up to `WRONG_RAD`.
    """

    print_scale: float = 1.0
    blur_px: float = 0.0
    bump: tuple[float, ...] = ()
    bump_at: int = 0
    lens: tuple[float, ...] = ()
    wrong_joints: tuple[int, ...] = ()


WRONG_RAD = 0.06


@dataclass
class StandIn:
    """The state that arm and camera share.

    Attributes:
        truth: where everything really is.
        q: joint positions as the encoders read them. Shape (J,).
        T_base_real: where the hand really is. Shape (4, 4).
        time: stand-in's time [s].
        pictures: pictures taken so far.
        wrong_next: the next reading of the joints is wrong.
    """

    truth: Truth
    kinematics: Kinematics
    board: Board
    faults: Faults
    rng: np.random.Generator
    q: Array = field(init=False)
    T_base_real: Array = field(init=False)
    time: float = 0.0
    pictures: int = 0
    wrong_next: bool = False

    def __post_init__(self) -> None:
        """The arm is where the user has put it."""
        self.arrive(self.truth.q_start)

    def arrive(self, q: Array) -> None:
        """The arm comes to rest at q (J,), off by its repeatability."""
        self.q = q.copy()
        jitter = make(exp(self.rng.normal(0, REPEAT_RAD, 3)), self.rng.normal(0, REPEAT_M, 3))
        self.T_base_real = self.kinematics.fk_hand(q + self.truth.encoder) @ jitter @ self.truth.T_hand_real

    def T_cam_board(self) -> Array:
        """What the camera sees now, bump included. Shape (4, 4)."""
        T = self.truth.T_cam_board(self.T_base_real)
        if self.faults.bump and self.pictures >= self.faults.bump_at:
            T = moved(np.eye(4), np.array(self.faults.bump)) @ T
        return T

    def T_cam_base(self) -> Array:
        """The base in the camera. Shape (4, 4)."""
        X = self.truth.X
        return invert(X if self.truth.mode == "eye-to-hand" else self.T_base_real @ X)

    @property
    def table(self) -> Array:
        """The table top in the base. Shape (4, 4)."""
        return self.kinematics.robot.T_base_task.matrix() @ translation(0.0, 0.0, TABLE_HEIGHT)

    def now(self) -> float:
        """Time [s]."""
        return self.time

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self.time += max(seconds, 0.0)


def stand_in(truth: Truth, kinematics: Kinematics, board: Board, seed: int, faults: Faults | None = None) -> StandIn:
    """A stand-in whose noise depends on `seed` alone."""
    return StandIn(truth, kinematics, board, faults or Faults(), np.random.default_rng([seed, 77]))


class StandInArm(Unconnected):
    """An `Arm` that is at once at the end of its trajectory."""

    def __init__(self, world: StandIn) -> None:
        """Moves the state that it shares with the camera."""
        self._world = world

    @property
    def joint_names(self) -> tuple[str, ...]:
        """In the order of every array."""
        return tuple(self._world.kinematics.robot.joints)

    def state(self) -> ArmState:
        """Joint positions now; wrong ones beside the pictures that the faults name."""
        world = self._world
        q = world.q.copy()
        if world.wrong_next:
            world.wrong_next = False
            rng = np.random.default_rng([world.pictures, 5])
            q += rng.uniform(0.4, 1.0, len(q)) * rng.choice([-1.0, 1.0], len(q)) * WRONG_RAD
        return ArmState(world.time, q, np.zeros(len(q)), ArmMode.IDLE)

    def execute(self, trajectory: Trajectory) -> "Arrived":
        """Go to the end of a trajectory."""
        self._world.time += trajectory.duration
        self._world.arrive(trajectory.q[-1])
        return Arrived()

    def recover(self, timeout: float) -> None:
        """There is nothing to recover from."""


class Arrived:
    """A motion that has ended."""

    def wait(self, timeout: float) -> MotionResult | None:
        """The result."""
        return MotionResult(True, "reached", 0.0)

    def cancel(self) -> None:
        """Too late."""


class StandInCamera(Unconnected):
    """A `Camera` whose pictures of the board are cast ray by ray."""

    def __init__(self, world: StandIn, frame_id: str) -> None:
        """Sees the state that it shares with the arm."""
        self._world, self._frame_id = world, frame_id
        truth = world.truth
        self._painter = BoardPainter(world.board, truth.intrinsics, truth.print_scale * world.faults.print_scale)
        self._light = float(world.rng.uniform(0.65, 1.05))
        self._factor = float(world.rng.normal(1.0, DEPTH_FACTOR))

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the stream, as the camera says."""
        world = self._world
        return corrected(world.truth.told, np.array(world.faults.lens)) if world.faults.lens else world.truth.told

    @property
    def frame_id(self) -> str:
        """Name of the optical frame."""
        return self._frame_id

    def capture(self, *, after: float, timeout: float) -> Frame:
        """A picture now, with depth."""
        world = self._world
        world.time = max(world.time, after)
        T = world.T_cam_board()
        gray = self._painter.paint(T, self._exposure(T))
        depth = self._depth(T)
        world.wrong_next = world.pictures in world.faults.wrong_joints
        world.pictures += 1
        color = np.repeat(gray[:, :, None], 3, axis=2)
        return Frame(depth, DEPTH_SCALE, self.intrinsics, world.time, self._frame_id, color, world.pictures)

    def _exposure(self, T_cam_board: Array) -> Exposure:
        """How the next picture is taken: at random, and as the faults say."""
        rng, world = self._world.rng, self._world
        hidden: tuple[tuple[float, float, float], ...] = ()
        corners = self._painter.corner_pixels(T_cam_board)
        if rng.random() < HIDDEN_SHARE:
            edge = corners[rng.integers(4)] + rng.normal(0, 12, 2)
            hidden = ((float(edge[0]), float(edge[1]), float(rng.uniform(15, 55))),)
        blur = rng.normal(0, 0.3, 2)
        if world.faults.blur_px > 0:
            direction = rng.uniform(-np.pi, np.pi)
            blur = world.faults.blur_px * rng.uniform(0.8, 1.2) * np.array([np.cos(direction), np.sin(direction)])
        return Exposure(
            gain=self._light * float(np.exp(rng.normal(0, 0.15))),
            slope=(float(rng.uniform(-0.3, 0.3)), float(rng.uniform(-0.3, 0.3))),
            defocus=float(rng.uniform(0.4, 0.75)),
            motion=(float(blur[0]), float(blur[1])),
            hidden=hidden,
            seed=int(rng.integers(1 << 31)),
        )

    def _depth(self, T_cam_board: Array) -> np.ndarray[tuple[int, int], np.dtype[np.uint16]]:
        """Depth of the plate as stereo would measure it, 0 elsewhere. Shape (H, W)."""
        T_cam_table = self._world.T_cam_base() @ self._world.table
        return self._painter.depth(T_cam_board, T_cam_table, self._factor, DEPTH_NOISE, DEPTH_SCALE, self._world.rng)
