"""Values that pass between rooms: frozen, with shapes and units."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import VOXEL_SIZE, WORKSPACE_SIZE, Array


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole camera.

    Attributes:
        width, height: image size [px].
        fx, fy, cx, cy: focal lengths and principal point [px]; pixel centres are at integers.
        distortion: Brown-Conrady coefficients k1 k2 p1 p2 k3, empty when rectified.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    @property
    def K(self) -> Array:
        """Camera matrix. Shape (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Frame:
    """One exposure of a depth camera.

    Attributes:
        depth: raw depth, uint16, shape (H, W); 0 means no measurement.
        depth_scale: metres per unit of `depth` [m].
        color: uint8 RGB, shape (H, W, 3), or None. Registered to the depth image.
        intrinsics: of the depth stream.
        stamp: when it was exposed, on the camera's clock domain of `Clock.now` [s].
        frame_id: name of the optical frame the depth is in.
        number: frame counter of the device.
    """

    depth: NDArray[np.uint16]
    depth_scale: float
    intrinsics: Intrinsics
    stamp: float
    frame_id: str
    color: NDArray[np.uint8] | None = None
    number: int = 0

    def metres(self) -> NDArray[np.float32]:
        """Depth along the optical axis [m], 0 where there is none. Shape (H, W)."""
        return self.depth.astype(np.float32) * np.float32(self.depth_scale)


@dataclass(frozen=True)
class TsdfGrid:
    """The network's view of the workspace cube, in the task frame (spec §1).

    Attributes:
        values: float32 (40, 40, 40), index (x, y, z): (f+1)/2 in the band, 0 for unknown AND far free space.
        observed: bool (40, 40, 40), voxels that some ray measured (free or surface).
        size: side of the cube [m].
    """

    values: NDArray[np.float32]
    observed: NDArray[np.bool_]
    size: float = WORKSPACE_SIZE


@dataclass(frozen=True)
class CollisionVolume:
    """A coarser, wider picture of the same frames for collision checks, in the base frame.

    Attributes:
        occupied: bool (X, Y, Z), voxels with a seen surface.
        observed: bool (X, Y, Z), voxels known to be free or surface.
        origin: corner of voxel (0, 0, 0) in the base frame [m]. Shape (3,).
        voxel_size: side of one voxel [m].
    """

    occupied: NDArray[np.bool_]
    observed: NDArray[np.bool_]
    origin: Array
    voxel_size: float


@dataclass(frozen=True)
class Grasps:
    """Ranked grasps, best first.

    Attributes:
        T_task_grasp: float64 (N, 4, 4).
        width: predicted opening [m]. Shape (N,).
        score: in [0, 1], descending. Shape (N,).
    """

    T_task_grasp: Array
    width: Array
    score: Array

    def __len__(self) -> int:
        """Number of grasps."""
        return len(self.score)

    @staticmethod
    def empty() -> "Grasps":
        """No grasp at all."""
        return Grasps(np.zeros((0, 4, 4)), np.zeros(0), np.zeros(0))


class Verdict(StrEnum):
    """What became of one candidate grasp: accepted, or the ONE reason against it."""

    ACCEPTED = "accepted"
    OUT_OF_WORKSPACE = "out of workspace"
    WIDTH = "width"
    IK = "ik"
    JOINT_LIMIT = "joint limit"
    SELF_COLLISION = "self collision"
    GRIPPER_COLLISION = "gripper-scene collision"
    ARM_COLLISION = "arm-scene collision"
    NO_PATH = "no path"
    REJECTED = "rejected by a person"
    NOT_EXAMINED = "not examined"


@dataclass(frozen=True)
class Trajectory:
    """A timed joint path, sampled evenly; the first sample is where it starts, at rest at both ends.

    Attributes:
        joint_names: the J joints, in column order.
        dt: sample interval [s].
        q, dq, ddq: position [rad], velocity [rad/s], acceleration [rad/s^2]. Shape (M, J).
    """

    joint_names: tuple[str, ...]
    dt: float
    q: Array
    dq: Array
    ddq: Array

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return self.dt * (len(self.q) - 1)


class ArmMode(StrEnum):
    """What the arm's controller says it is doing."""

    IDLE = "idle"
    MOVING = "moving"
    GUIDING = "guiding"
    REFLEX = "reflex"
    USER_STOPPED = "user stopped"
    OTHER = "other"


@dataclass(frozen=True)
class ArmState:
    """A stamped reading of the arm.

    Attributes:
        stamp: when it was read [s].
        q, dq: joint positions [rad] and velocities [rad/s]. Shape (J,).
        mode: the controller's mode.
        errors: names of active errors, empty when healthy.
        wrench: external force [N] and torque [Nm] at the tcp in the base frame. Shape (6,).
    """

    stamp: float
    q: Array
    dq: Array
    mode: ArmMode
    errors: tuple[str, ...] = ()
    wrench: Array = field(default_factory=lambda: np.zeros(6))


@dataclass(frozen=True)
class MotionResult:
    """How a motion ended.

    Attributes:
        reached: whether the goal was reached.
        reason: "reached", "cancelled", or the device's own words.
        goal_error: largest joint distance to the goal [rad].
    """

    reached: bool
    reason: str
    goal_error: float


@dataclass(frozen=True)
class GripperState:
    """A stamped reading of the gripper: opening `width` [m] and whether the device reports a held object."""

    stamp: float
    width: float
    is_grasped: bool


@dataclass(frozen=True)
class GripperResult:
    """What a gripper command ended with: the device's own verdict and the opening it stopped at [m]."""

    success: bool
    width: float
    message: str = ""


@dataclass(frozen=True)
class Box:
    """A declared obstacle: an axis-aligned box in the base frame.

    Attributes:
        name: how reports call it.
        size: full side lengths [m].
        center: [m].
    """

    name: str
    size: tuple[float, float, float]
    center: tuple[float, float, float]


@dataclass(frozen=True)
class Capsule:
    """All points within `radius` of a segment; a sphere when both ends are equal.

    Attributes:
        p0, p1: ends of the segment in the base frame [m]. Shape (3,).
        radius: [m].
        name: the link it belongs to.
    """

    p0: Array
    p1: Array
    radius: float
    name: str = ""


__all__ = [
    "VOXEL_SIZE",
    "ArmMode",
    "ArmState",
    "Box",
    "Capsule",
    "CollisionVolume",
    "Frame",
    "Grasps",
    "GripperResult",
    "GripperState",
    "Intrinsics",
    "MotionResult",
    "Trajectory",
    "TsdfGrid",
    "Verdict",
]
