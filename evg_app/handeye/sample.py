"""What a calibration session holds: samples with what was seen in them. No truth is in here."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from evg_app.config.calibration import Mode
from evg_app.geometry import Array, invert
from evg_app.handeye.boards import Board, Gray
from evg_app.handeye.detect import Detection, board_pose
from evg_app.handeye.lens import undistort
from evg_app.types import Intrinsics

STRIDE = 8
"""Every STRIDE-th row and column of the depth is kept."""


def coarse(depth: NDArray[np.uint16], unit: float) -> NDArray[np.float32]:
    """What is kept of a depth image (H, W) in units of `unit` [m]."""
    return np.asarray(depth[::STRIDE, ::STRIDE], dtype=np.float32) * np.float32(unit)


@dataclass(frozen=True)
class Sample:
    """One stop of the arm.

    Attributes:
        number: in the order taken, from 0.
        q: joint positions the arm reported [rad]. Shape (J,).
        T_base_hand: from them. Shape (4, 4).
        detection: what was found in the picture.
        gray: the picture, 8 bit (H, W); None when it is not kept in memory.
        coarse_depth: every 8th row and column of the depth image [m], 0 where none; empty without depth.
        board_depth: depth camera's distance of the board's seen corners along the axis [m], NaN where none. (n,).
    """

    number: int
    q: Array
    T_base_hand: Array
    detection: Detection
    gray: Gray | None = None
    board_depth: Array = field(default_factory=lambda: np.zeros(0))
    coarse_depth: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 0), np.float32))


@dataclass(frozen=True)
class Session:
    """Everything the solver is given.

    `T_picture_cam` maps the camera frame that the result is for to the frame of the pictures: the identity, or the
    device's depth-to-colour transform when the board was seen by the colour camera.
    """

    mode: Mode
    robot: str
    camera: str
    parent_frame: str
    camera_frame: str
    intrinsics: Intrinsics
    board: Board
    T_base_task: Array
    samples: tuple[Sample, ...]
    T_picture_cam: Array = field(default_factory=lambda: np.eye(4))

    def usable(self) -> "list[Sample]":
        """Samples whose picture can be used."""
        return [sample for sample in self.samples if sample.detection.ok]

    def seen_through(self, lens: Intrinsics) -> "Session":
        """The same pictures with other intrinsics: distortion is taken out anew."""
        samples = []
        for sample in self.samples:
            found = sample.detection
            if found.ok:
                ideal = undistort(found.pixels, lens)
                T, off = board_pose(self.board.points[found.ids], ideal, lens)
                sample = replace(sample, detection=replace(found, ideal=ideal, T_cam_board=T, fit=off))
            samples.append(sample)
        return replace(self, intrinsics=lens, samples=tuple(samples))

    def with_samples(self, samples: "tuple[Sample, ...] | list[Sample]") -> "Session":
        """The same session with other samples."""
        return replace(self, samples=tuple(samples))


@dataclass(frozen=True)
class Views:
    """Samples as arrays of the one equation of both modes: p_cam = X^-1 A Z p_board.

    X is the camera in the parent frame and Z the board in the other one; A = T_base_hand (eye-to-hand) or its inverse
    (eye-in-hand). Corners of all samples stand in one list.

    Attributes:
        A: shape (N, 4, 4).
        B: T_cam_board of each sample alone. Shape (N, 4, 4).
        sample: which sample each corner belongs to, ascending. Shape (M,).
        points: in the board frame, nominal size [m]. Shape (M, 3).
        pixels: undistorted. Shape (M, 2).
        numbers: of the samples in their session. Shape (N,).
        intrinsics: of the stream.
        mode: where the camera is.
    """

    A: Array
    B: Array
    sample: NDArray[np.int64]
    points: Array
    pixels: Array
    numbers: NDArray[np.int64]
    intrinsics: Intrinsics
    mode: Mode = "eye-to-hand"

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.A)

    def take(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> "Views":
        """Only some samples, given as flags or as ascending indices (K,)."""
        index = np.flatnonzero(keep) if keep.dtype == np.bool_ else np.asarray(keep)
        place = np.full(len(self.A), -1)
        place[index] = np.arange(len(index))
        rows = place[self.sample] >= 0
        return replace(
            self,
            A=self.A[index],
            B=self.B[index],
            sample=place[self.sample[rows]],
            points=self.points[rows],
            pixels=self.pixels[rows],
            numbers=self.numbers[index],
        )

    def swapped(self) -> "Views":
        """As if the camera stood in the other place."""
        other: Mode = "eye-in-hand" if self.mode == "eye-to-hand" else "eye-to-hand"
        return replace(self, A=invert(self.A), mode=other)


def views_of(session: Session, samples: list[Sample]) -> Views:
    """Arrays of some samples of a session."""
    H = np.stack([s.T_base_hand for s in samples]) if samples else np.zeros((0, 4, 4))
    A = H if session.mode == "eye-to-hand" else invert(H)
    none3, none2 = np.zeros((0, 3)), np.zeros((0, 2))
    return Views(
        A,
        np.stack([s.detection.T_cam_board for s in samples]) if samples else np.zeros((0, 4, 4)),
        np.concatenate([np.full(len(s.detection.ids), k) for k, s in enumerate(samples)] or [np.zeros(0, np.int64)]),
        np.concatenate([session.board.points[s.detection.ids] for s in samples] or [none3]),
        np.concatenate([s.detection.ideal for s in samples] or [none2]),
        np.array([s.number for s in samples], dtype=np.int64),
        session.intrinsics,
        session.mode,
    )
