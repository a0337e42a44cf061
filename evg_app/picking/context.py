"""What the loop is handed: devices, planner, motion, perception, and who listens. Protocols only."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from evg_app.cameras.protocol import Camera
from evg_app.clock import Clock
from evg_app.config.models import CameraConfig, RobotConfig
from evg_app.events import Answer, GraspOffered, Sink
from evg_app.geometry import Array
from evg_app.grasping.protocol import Planner
from evg_app.perception.change import SceneChange
from evg_app.picking.stop import StopToken
from evg_app.robots.protocol import Arm, Gripper
from evg_app.types import CollisionVolume, Frame, Grasps, Trajectory, TsdfGrid, Verdict


@dataclass(frozen=True)
class Devices:
    """The three devices, already entered, and the clock they share."""

    camera: Camera
    arm: Arm
    gripper: Gripper
    clock: Clock


@dataclass(frozen=True)
class View:
    """One observation of the workspace.

    Attributes:
        tsdf: the planner's grid.
        volume: the collision volume in the base frame.
        points: how many measured points lie above the table inside the workspace.
        depth_factor: what the depth was multiplied with to bring the table to its known height.
    """

    tsdf: TsdfGrid
    volume: CollisionVolume
    points: int
    depth_factor: float = 1.0


class Perception(Protocol):
    """From a frame to a view. `q` [rad], shape (J,), is the arm's position at exposure."""

    @property
    def T_base_task(self) -> Array:
        """Where the workspace is. Shape (4, 4)."""

    def T_base_cam(self, q: Array) -> Array:
        """Where the camera is. Shape (4, 4)."""

    def clean(self, frame: Frame, q: Array) -> Frame:
        """The frame without the arm's own links."""

    def problem(self, frame: Frame, q: Array) -> str:
        """Why no plan may be made on this frame, empty when it is good enough."""

    def blind(self, frame: Frame, q: Array) -> str:
        """Why this frame shows nothing at all, empty when it does: the arm may stand before the whole workspace."""

    def view(self, frame: Frame, q: Array, further: Sequence[tuple[Frame, Array]] = ()) -> View:
        """Fuse a clean frame, and clean frames of further views with the arm's positions [rad] at their exposure."""

    def change(
        self, before: tuple[Frame, Array], after: tuple[Frame, Array], T_base_grasp: Array, radius: float, step: float
    ) -> SceneChange:
        """What changed near a grasp (4, 4) between two frames, each with its q, by more than `step` [m] of depth."""


@dataclass(frozen=True)
class ReadyPick:
    """A pick that is ready to be executed, whole.

    Attributes:
        T_base_grasp: the grasp that is executed. Shape (4, 4).
        reach: from the look pose to the pre-grasp.
        approach: straight to the grasp.
        lift: up with the object.
        transport: to above the bin.
        back: from the bin to the look pose.
        retreat: from the lifted pose to the look pose without an object.
    """

    T_base_grasp: Array
    reach: Trajectory
    approach: Trajectory
    lift: Trajectory
    transport: Trajectory
    back: Trajectory
    retreat: Trajectory

    def trajectories(self) -> Mapping[str, Trajectory]:
        """By name."""
        names = ("reach", "approach", "lift", "transport", "back", "retreat")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class Decision:
    """One verdict per candidate, and the pick to execute, or None."""

    verdicts: tuple[Verdict, ...]
    pick: ReadyPick | None
    grasp_index: int | None
    flipped: bool


class Motion(Protocol):
    """Feasibility and joint paths (`evg_app.picking.motion` adapts `evg_app.motion` to it)."""

    def decide(self, grasps: Grasps, T_base_task: Array, view: View, q_start: Array) -> Decision:
        """Judge candidates, best first, until one can be executed. `q_start` [rad], shape (J,)."""

    def route(self, q_start: Array, q_goal: Array, view: View | None) -> Trajectory | None:
        """A collision-free path [rad], around the view when given; None when there is none."""


class Referee(Protocol):
    """Somebody who knows the truth: the simulator, or an operator."""

    def in_bin(self) -> int:
        """How many objects of this round lie in the bin."""

    def on_table(self) -> int:
        """How many objects of this round are left in the workspace."""


class Supervisor(Protocol):
    """Somebody who may hold the loop; `picking.supervise` asks again and again, and whoever fails has not answered."""

    @property
    def asks(self) -> bool:
        """Whether to be asked before each grasp."""

    def may_go_on(self, state: str, timeout: float) -> bool:
        """Whether the loop may go on to this state; may wait up to `timeout` [s] of wall time before a no."""

    def judge(self, offered: GraspOffered, timeout: float) -> Answer | None:
        """What becomes of a planned grasp; None while nothing was said, after up to `timeout` [s] of wall time."""


class Rounds(Protocol):
    """Whoever sets the table."""

    def prepare(self, round_index: int, seed: int) -> int | None:
        """Set up a round; how many objects it has, None when nobody counted."""


@dataclass(frozen=True)
class Settings:
    """Limits of the loop.

    Attributes:
        slice_s: length of one wait slice [s].
        motion_slack: a motion may take its duration times this, plus `motion_grace_s` [s].
        contact_slices: slices in a row above the contact limit that cancel an approach.
        close_after_contact: close where contact stopped the approach, as the paper does (spec §6.2, §7.3);
            otherwise such an approach has failed and the arm backs out.
        at_pose_rad: the arm counts as being at a pose within this [rad].
        rest_rad_s: the arm is at rest below this joint speed [rad/s].
        rest_timeout_s: how long to wait for rest [s].
        capture_tries: frames to try before the camera is given up.
        recover_tries: attempts at one recovery.
        recover_timeout_s: of one attempt at recovery [s].
        max_recoveries: recoveries in a row, without a clean pass between, before the round ends.
        max_failures: failures in a row that end a round (spec §6.1).
        max_attempts: passes through the loop that end a round.
        empty_points: fewer measured points above the table are an empty view.
    """

    slice_s: float = 0.02
    motion_slack: float = 1.5
    motion_grace_s: float = 5.0
    contact_slices: int = 2
    close_after_contact: bool = True
    at_pose_rad: float = 0.02
    rest_rad_s: float = 0.02
    rest_timeout_s: float = 3.0
    capture_tries: int = 3
    recover_tries: int = 2
    recover_timeout_s: float = 20.0
    max_recoveries: int = 3
    max_failures: int = 2
    max_attempts: int = 30
    empty_points: int = 20


def _nothing() -> None:
    """The default tick."""


@dataclass(frozen=True)
class Context:
    """Everything one run needs.

    Attributes:
        sink: who listens to the event stream.
        referee: knows the truth; without one, verify's judgement counts.
        supervisor: may hold the loop and reject grasps; without one it never waits.
        stop: how a person stops the run.
        tick: called in every wait slice (a film, a live view); must be quick.
        stopwatch: wall time for compute stages [s].
    """

    devices: Devices
    perception: Perception
    planner: Planner
    motion: Motion
    robot: RobotConfig
    camera: CameraConfig
    sink: Sink
    referee: Referee | None = None
    stop: StopToken = field(default_factory=StopToken)
    settings: Settings = Settings()
    tick: Callable[[], None] = _nothing
    stopwatch: Callable[[], float] = time.perf_counter
    supervisor: Supervisor | None = None
