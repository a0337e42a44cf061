"""How the run goes: runs, rounds, passes, states, stages, and what a person should know."""

from collections.abc import Mapping
from dataclasses import dataclass

from evg_app.events.motion import Evidence
from evg_app.events.outcomes import AttemptOutcome, Stage, StopReason


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
class DevicesConnected:
    """Before a run: what camera, arm and gripper say of themselves (driver, versions, serial numbers), by name."""

    devices: Mapping[str, Mapping[str, str]]


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
