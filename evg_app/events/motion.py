"""What arm and gripper did, and what an outcome rests on."""

from dataclasses import dataclass

from evg_app.geometry import Array
from evg_app.types import GripperResult, GripperState, MotionResult, Trajectory


@dataclass(frozen=True, eq=False)
class Routed:
    """A way was planned from where the arm stood [rad] to a goal [rad], shapes (J,).

    Attributes:
        around_scene: it goes around what was seen; otherwise around what is declared alone.
    """

    name: str
    q_start: Array
    q_goal: Array
    around_scene: bool
    way: Trajectory


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
        width_emptied: where the fingers stopped when they were closed once more, above the bin after opening [m].
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
    width_emptied: float | None = None
    gripper_success: bool | None = None
    is_grasped_lifted: bool | None = None
    is_grasped_release: bool | None = None
    in_bin_before: int | None = None
    in_bin_after: int | None = None
    contact: bool | None = None
    place_area: float | None = None
    place_compared: float | None = None
