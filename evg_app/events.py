"""The one append-only stream that the loop writes and that the trial log and every view read."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from evg_app.geometry import Array
from evg_app.types import (
    CollisionVolume,
    Frame,
    Grasps,
    GripperResult,
    GripperState,
    MotionResult,
    Trajectory,
    TsdfGrid,
    Verdict,
)


class StopReason(StrEnum):
    """Why a round ended."""

    CLEARED = "cleared"
    TWO_FAILURES = "two consecutive failures"
    NO_GRASP = "no grasp"
    NO_FEASIBLE = "no feasible grasp"
    ATTEMPT_LIMIT = "attempt limit"
    STOPPED = "stopped by the user"
    ERROR = "error"


class AttemptOutcome(StrEnum):
    """How a pass through the loop ended. Only `SUCCESS` and `FAILURE` are attempts that count (spec §6.1)."""

    SUCCESS = "success"
    FAILURE = "failure"
    ABANDONED = "abandoned"
    NO_GRASP = "no grasp"
    NO_FEASIBLE = "no feasible grasp"
    EMPTY_VIEW = "empty view"
    REPLANNED = "replanned"
    ERROR = "error"

    @property
    def counts(self) -> bool:
        """Whether a grasp was physically executed and so counts in GSR."""
        return self in (AttemptOutcome.SUCCESS, AttemptOutcome.FAILURE)


class Stage(StrEnum):
    """Timed parts of a pass. `COMPUTE_STAGES` are those between a depth image and a ready trajectory."""

    CAPTURE = "capture"
    FILTER = "filter"
    FUSE = "fuse"
    PLAN = "plan"
    JUDGE = "judge"
    ROUTE = "route"
    RECHECK = "recheck"


COMPUTE_STAGES = (Stage.FILTER, Stage.FUSE, Stage.PLAN, Stage.JUDGE)
"""From the depth image to the ready trajectory; `capture` waits for a device, `route` plans way-back motions."""


@dataclass(frozen=True, eq=False)
class RunStarted:
    """A run begins: `rounds` rounds for each seed."""

    seeds: tuple[int, ...]
    rounds: int
    model: str
    weights_sha256: str


@dataclass(frozen=True, eq=False)
class RoundStarted:
    """A round begins; `round_index` counts from 0 within its seed, `objects` is None when nobody knows."""

    seed: int
    round_index: int
    objects: int | None


@dataclass(frozen=True, eq=False)
class AttemptStarted:
    """A pass through the loop begins; `index` counts from 0 within its round.

    Attributes:
        planner_seed: seed handed to the planner, derived from (seed, round_index, index).
    """

    attempt_id: str
    seed: int
    round_index: int
    index: int
    planner_seed: int


@dataclass(frozen=True, eq=False)
class StateEntered:
    """The state machine is in this state."""

    state: str


@dataclass(frozen=True, eq=False)
class StageTimed:
    """A stage took `wall_ms` of wall time [ms]."""

    stage: Stage
    wall_ms: float


@dataclass(frozen=True, eq=False)
class FrameTaken:
    """A frame was taken with the arm at rest at `q` [rad], shape (J,). Transforms are (4, 4)."""

    frame: Frame
    q: Array
    T_base_cam: Array
    T_base_task: Array


@dataclass(frozen=True, eq=False)
class ViewTaken:
    """A frame from the robot's `view_q_rad[index]`; it is fused with the `FrameTaken` that follows. Else as there."""

    index: int
    frame: Frame
    q: Array
    T_base_cam: Array


@dataclass(frozen=True, eq=False)
class Fused:
    """The frame, its depth times `depth_factor`, became the planner's grid; `points` lie above the table.

    `volume` is what motion is judged against.
    """

    grid: TsdfGrid
    points: int
    depth_factor: float = 1.0
    volume: CollisionVolume | None = None


@dataclass(frozen=True, eq=False)
class GraspsPlanned:
    """What the planner proposed, best first."""

    grasps: Grasps


@dataclass(frozen=True, eq=False)
class Judged:
    """One verdict per candidate, and the pick that was made ready.

    Attributes:
        verdicts: in the order of the grasps.
        chosen: index of the chosen grasp, or None.
        flipped: whether its antipodal twin is executed.
        T_base_grasp: the pose that is executed, shape (4, 4), or None.
        trajectories: by name.
    """

    verdicts: tuple[Verdict, ...]
    chosen: int | None = None
    flipped: bool = False
    T_base_grasp: Array | None = None
    trajectories: Mapping[str, Trajectory] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class SceneRechecked:
    """Before the approach: `area` [m^2] of surface near the grasp came or went; `compared` is the share looked at.

    With `changed` the pass ends here, and the scene is planned on anew.
    """

    changed: bool
    area: float
    compared: float


@dataclass(frozen=True, eq=False)
class MotionStarted:
    """The arm was sent a trajectory of `duration` [s]."""

    name: str
    duration: float


@dataclass(frozen=True, eq=False)
class MotionEnded:
    """A motion ended after `seconds` [s] of the clock."""

    name: str
    result: MotionResult
    seconds: float


@dataclass(frozen=True, eq=False)
class GripperMoved:
    """A gripper command ended after `seconds` [s] of the clock."""

    command: str
    result: GripperResult
    seconds: float


@dataclass(frozen=True, eq=False)
class Verified:
    """A look at the gripper: `when` is "lift" or "release", `held` evg-app's own judgement."""

    when: str
    state: GripperState
    held: bool


@dataclass(frozen=True, eq=False)
class Evidence:
    """What an attempt's outcome rests on. None where the attempt never got that far.

    Attributes:
        width_closed, width_lifted, width_release: openings [m].
        gripper_success: the device's own verdict on closing.
        is_grasped_lifted, is_grasped_release: the device's own flag.
        in_bin_before, in_bin_after: the referee's counts.
        contact: contact stopped the approach.
        place_area: surface that came or went where the fingers closed, between before and after the pick [m^2].
        place_compared: share of that place that both images show.
    """

    width_closed: float | None = None
    width_lifted: float | None = None
    width_release: float | None = None
    gripper_success: bool | None = None
    is_grasped_lifted: bool | None = None
    is_grasped_release: bool | None = None
    in_bin_before: int | None = None
    in_bin_after: int | None = None
    contact: bool | None = None
    place_area: float | None = None
    place_compared: float | None = None


@dataclass(frozen=True, eq=False)
class AttemptFinished:
    """A pass through the loop ended.

    Attributes:
        verified: verify's judgement, None when nothing was closed.
        truth: the referee's judgement, None without one.
        failure: reason of failure, empty on success.
        motion_s: time in arm, gripper and camera commands, on the clock [s].
        compute_ms: wall time from depth image to ready trajectory, way-back routes included [ms].
    """

    attempt_id: str
    outcome: AttemptOutcome
    verified: bool | None
    truth: bool | None
    failure: str
    evidence: Evidence
    motion_s: float
    compute_ms: float


@dataclass(frozen=True, eq=False)
class RoundFinished:
    """A round ended; `detail` says more about an error."""

    seed: int
    round_index: int
    objects: int | None
    stop_reason: StopReason
    detail: str = ""


@dataclass(frozen=True, eq=False)
class RunFinished:
    """The run ended: "finished", "stopped by the user" or "error"."""

    status: str
    detail: str = ""


@dataclass(frozen=True, eq=False)
class DepthChecked:
    """The camera was judged before a run: `measures` by name ([m], [deg], shares), `advice` empty when good enough."""

    measures: Mapping[str, float]
    text: str
    advice: str = ""


@dataclass(frozen=True, eq=False)
class Warned:
    """Something a person should know; the loop goes on. `cause` is a short machine-readable word."""

    cause: str
    text: str


Event = (
    RunStarted
    | RoundStarted
    | AttemptStarted
    | StateEntered
    | StageTimed
    | FrameTaken
    | ViewTaken
    | Fused
    | GraspsPlanned
    | Judged
    | SceneRechecked
    | MotionStarted
    | MotionEnded
    | GripperMoved
    | Verified
    | AttemptFinished
    | RoundFinished
    | RunFinished
    | DepthChecked
    | Warned
)
"""Everything the loop says."""

Sink = Callable[[Event], None]
"""Whoever listens."""


def fan_out(*sinks: Sink) -> Sink:
    """One sink that feeds several, in order; the first error is raised after all were fed."""

    def feed(event: Event) -> None:
        failures: list[Exception] = []
        for sink in sinks:
            try:
                sink(event)
            except Exception as error:
                failures.append(error)
        if failures:
            raise failures[0]

    return feed
