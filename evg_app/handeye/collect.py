"""Taking samples: move, rest, look, detect. Automatic around the current view, or where the user guides the arm."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from evg_app.cameras.protocol import Camera
from evg_app.clock import Clock
from evg_app.config.calibration import Mode
from evg_app.config.models import CameraConfig, RobotConfig
from evg_app.errors import BadInput, HardwareError, Refused
from evg_app.geometry import Array
from evg_app.handeye.boards import Board, Gray
from evg_app.handeye.detect import Detection, detect
from evg_app.handeye.poses import Reach, Stop, first_motions, plan_stops
from evg_app.handeye.sample import Sample, Session, coarse, views_of
from evg_app.handeye.solve import fit_without_outliers
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.slower import slowed
from evg_app.robots.protocol import Arm
from evg_app.types import Frame

REST = 0.4
"""Time between the end of a motion and the exposure, for vibrations to die [s]."""
MOTION_TIMEOUT = 30.0
"""Longest motion between two stops [s]."""
FRAME_TIMEOUT = 5.0
"""[s]."""
LEAST_FIRST = 4
"""Usable samples that the first motions must give."""

OnSample = Callable[[Sample, Frame], None]


@dataclass(frozen=True)
class Bench:
    """The devices of one calibration, entered.

    Attributes:
        arm, camera, clock: the devices.
        motion: plans collision-free motions of the arm.
        robot, camera_config: their files.
        board: what is looked for.
        mode: where the camera is.
        share: of the configured speed.
        T_picture_cam: camera frame in the frame of the pictures (see `Session`).
        on_sample: told about every sample, for storing and showing it.
    """

    arm: Arm
    camera: Camera
    clock: Clock
    motion: MotionPlanner
    robot: RobotConfig
    camera_config: CameraConfig
    board: Board
    mode: Mode
    on_sample: OnSample
    share: float = 1.0
    T_picture_cam: Array = field(default_factory=lambda: np.eye(4))

    def session(self, samples: "list[Sample]") -> Session:
        """What the solver is given."""
        return Session(
            mode=self.mode,
            robot=self.robot.name,
            camera=self.camera_config.name,
            parent_frame=self.robot.hand_link if self.mode == "eye-in-hand" else "base",
            camera_frame=self.camera_config.frame_id,
            intrinsics=self.camera.intrinsics,
            board=self.board,
            T_base_task=self.robot.T_base_task.matrix(),
            samples=tuple(samples),
            T_picture_cam=self.T_picture_cam,
        )

    def take(self, number: int) -> Sample:
        """One sample where the arm rests.

        Raises:
            HardwareError: the arm or the camera failed.
        """
        self.clock.sleep(REST)
        sample, frame = self.look(number)
        self.on_sample(sample, frame)
        return sample

    def look(self, number: int) -> tuple[Sample, Frame]:
        """What a sample would be, taken at once and told to nobody.

        Raises:
            HardwareError: the arm or the camera failed.
        """
        frame = self.camera.capture(after=self.clock.now(), timeout=FRAME_TIMEOUT)
        q = self.arm.state().q.copy()
        return sample_of(number, q, self.motion.kinematics.fk_hand(q), frame, self.board), frame

    def go(self, q: Array) -> bool:
        """Move to a configuration (J,); False when there is no free path or the arm did not arrive."""
        try:
            trajectory = self.motion.go_to(self.arm.state().q, q)
        except (Refused, BadInput):
            return False
        result = self.arm.execute(slowed(trajectory, self.share)).wait(MOTION_TIMEOUT / self.share)
        return result is not None and result.reached


def gray_of(frame: Frame) -> Gray:
    """The picture as 8-bit grey (H, W).

    Raises:
        HardwareError: the frame has no picture.
    """
    if frame.color is None:
        raise HardwareError("the camera sends no picture beside its depth; switch its colour or infrared stream on")
    weights = np.array([0.299, 0.587, 0.114])
    return np.asarray(np.rint(frame.color.astype(np.float64) @ weights), dtype=np.uint8)


def sample_of(number: int, q: Array, T_base_hand: Array, frame: Frame, board: Board) -> Sample:
    """Detect the board in a frame."""
    gray = gray_of(frame)
    detection = detect(board, gray, frame.intrinsics)
    depth = coarse(frame.depth, frame.depth_scale)
    return Sample(number, q, T_base_hand, detection, gray, depth_at(frame, detection), depth)


def depth_at(frame: Frame, detection: Detection) -> Array:
    """Depth [m] at the detected corners (n,), NaN where there is none."""
    at = np.rint(detection.pixels).astype(np.int64)
    height, width = frame.depth.shape
    column, row = np.clip(at[:, 0], 0, width - 1), np.clip(at[:, 1], 0, height - 1)
    depth = frame.depth[row, column].astype(np.float64) * frame.depth_scale
    return np.where(depth > 0, depth, np.nan)


def collect(bench: Bench, count: int, seed: int) -> Session:
    """Take about `count` samples around the current view, planning the views once the first motions are known.

    A session whose first motions show too little of the board ends early; the solver says why.
    """
    samples: list[Sample] = [bench.take(0)]
    start = bench.arm.state().q.copy()
    reach = Reach(bench.motion)
    for choices in first_motions(bench.motion.kinematics.fk_hand(start)):
        found = (reach.configuration(hand, start) for hand in choices)
        if any(q is not None and bench.go(q) for q in found):
            samples.append(bench.take(len(samples)))
    if len(bench.session(samples).usable()) < LEAST_FIRST:
        bench.go(start)
        return bench.session(samples)
    for part in (0.5, 1.0):
        wanted = int(np.ceil(part * count)) - len(samples)
        for stop in _next_stops(bench, reach, samples, start, wanted, seed):
            if bench.go(stop.q):
                samples.append(bench.take(len(samples)))
    bench.go(start)
    return bench.session(samples)


def _next_stops(
    bench: Bench, reach: Reach, samples: "list[Sample]", near: Array, count: int, seed: int
) -> "Iterator[Stop]":
    """The views that add most to the samples so far; none when those cannot be solved."""
    session = bench.session(samples)
    views = views_of(session, session.usable())
    fit, _, _ = fit_without_outliers(views)
    if fit is None or count <= 0:
        return iter(())
    return iter(
        plan_stops(
            reach, bench.board, bench.camera.intrinsics, bench.mode, fit, views, near, count, seed + len(samples)
        )
    )


def visit(bench: Bench, stops: "list[Array]") -> Session:
    """Take a sample at each configuration (J,) that can be reached, in their order."""
    samples: list[Sample] = []
    for q in stops:
        if bench.go(q):
            samples.append(bench.take(len(samples)))
    return bench.session(samples)
