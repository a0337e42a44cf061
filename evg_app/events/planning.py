"""What was seen, proposed and chosen."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from evg_app.geometry import Array
from evg_app.types import CollisionVolume, Frame, Grasps, Trajectory, TsdfGrid, Verdict


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
