"""Models of the YAML files in `robot_configs/` and `sim/worlds/`: units in the key names, unknown keys rejected."""

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from evg_app.config.arm import AttachedBody, JointLimits
from evg_app.config.base import Model as Model
from evg_app.config.base import Positive, Vector3
from evg_app.config.camera import CameraConfig as CameraConfig
from evg_app.config.evidence import ContactModel, EvidenceModel
from evg_app.config.franka import FciModel, ToolBox
from evg_app.config.ros2 import Ros2Model
from evg_app.geometry import Array, from_quaternion
from evg_app.types import Box


class Pose(Model):
    """A rigid transform. Named by the field that holds it (`T_a_b`)."""

    xyz_m: Vector3
    quaternion_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    @model_validator(mode="after")
    def _unit(self) -> Self:
        norm = float(np.linalg.norm(self.quaternion_xyzw))
        if abs(norm - 1.0) > 1e-3:
            raise ValueError(f"quaternion_xyzw must have length 1, has {norm:.4f}")
        return self

    def matrix(self) -> Array:
        """The transform. Shape (4, 4)."""
        return from_quaternion(self.quaternion_xyzw, self.xyz_m)


class BoxModel(Model):
    """A declared obstacle, axis-aligned in the base frame."""

    name: str
    size_m: tuple[Positive, Positive, Positive]
    center_m: Vector3

    def box(self) -> Box:
        """As a value."""
        return Box(self.name, self.size_m, self.center_m)


class GripperModel(Model):
    """The parallel gripper. Grasps use width 0 and a wide outer epsilon: success is judged by evg-app.

    Something is held when the opening is above `held_width_m` and more than `open_margin_m` below the widest.
    """

    max_width_m: Positive = 0.08
    speed_m_s: Positive = 0.1
    force_n: Positive = 30.0
    epsilon_inner_m: Positive = 0.08
    epsilon_outer_m: Positive = 0.08
    held_width_m: Positive = 0.003
    open_margin_m: Positive = 0.001
    hand_to_grasp_z_m: float = 0.062
    timeout_s: Positive = 10.0


class DropModel(Model):
    """Where objects are dropped: an open bin, and joints above it."""

    bin_center_m: Vector3
    bin_size_m: tuple[Positive, Positive, Positive]
    wall_m: Positive = 0.01
    q_rad: tuple[float, ...]

    def walls(self) -> tuple[Box, ...]:
        """Floor and four walls as boxes in the base frame; `bin_center_m` is the centre of the floor's underside."""
        (x, y, z), (sx, sy, sz), w = self.bin_center_m, self.bin_size_m, self.wall_m
        return (
            Box("bin floor", (sx, sy, w), (x, y, z + w / 2)),
            Box("bin wall -x", (w, sy, sz), (x - sx / 2, y, z + sz / 2)),
            Box("bin wall +x", (w, sy, sz), (x + sx / 2, y, z + sz / 2)),
            Box("bin wall -y", (sx, w, sz), (x, y - sy / 2, z + sz / 2)),
            Box("bin wall +y", (sx, w, sz), (x, y + sy / 2, z + sz / 2)),
        )


class RobotConfig(Model):
    """One arm with its gripper and its place in the lab (`robot_configs/<name>.yaml`).

    Attributes:
        serial: of the arm, as on its base plate; neither the FCI nor ROS tells it, so it is logged from here.
        joints, hand_link: what everything outside the URDF calls them.
        urdf_joints, urdf_hand_link: what the URDF calls them, where that differs.
        look_q_rad: where the arm waits while the camera looks.
        view_q_rad: poses from which a camera on the hand looks before that; all views are fused.
        obstacles: declared boxes: walls, a camera stand.
        attached: declared bodies on the arm.
        unknown_space: "optimistic": what no camera saw is free; "conservative": inside the workspace cube it is not.
    """

    device: Literal["robot"]
    name: str
    driver: Literal["ros2", "fci"]
    description: str
    serial: str = ""
    urdf: str
    srdf: str
    joints: tuple[str, ...]
    hand_link: str
    urdf_joints: tuple[str, ...] = ()
    urdf_hand_link: str = ""
    T_base_task: Pose
    home_q_rad: tuple[float, ...]
    look_q_rad: tuple[float, ...]
    view_q_rad: tuple[tuple[float, ...], ...] = ()
    limits: JointLimits
    gripper: GripperModel
    drop: DropModel
    obstacles: tuple[BoxModel, ...] = ()
    attached: tuple[AttachedBody, ...] = ()
    unknown_space: Literal["optimistic", "conservative"] = "optimistic"
    pregrasp_m: Positive = 0.08
    lift_m: Positive = 0.15
    contact_force_n: Positive = 25.0
    contact: ContactModel = ContactModel()
    evidence: EvidenceModel = EvidenceModel()
    tool_box: ToolBox | None = None
    fci: FciModel = FciModel()
    ros2: Ros2Model | None = None

    @property
    def model_joints(self) -> tuple[str, ...]:
        """The joints' names in the URDF."""
        return self.urdf_joints or self.joints

    @property
    def model_hand_link(self) -> str:
        """The hand's name in the URDF."""
        return self.urdf_hand_link or self.hand_link

    @model_validator(mode="after")
    def _lengths(self) -> Self:
        n = len(self.joints)
        vectors: dict[str, tuple[object, ...]] = {
            "home_q_rad": self.home_q_rad,
            "look_q_rad": self.look_q_rad,
            "drop.q_rad": self.drop.q_rad,
            **{f"view_q_rad.{i}": q for i, q in enumerate(self.view_q_rad)},
            **self.limits.vectors(),
        }
        if self.urdf_joints:
            vectors["urdf_joints"] = self.urdf_joints
        for key, vector in vectors.items():
            if len(vector) != n:
                raise ValueError(f"{key} has {len(vector)} entries for {n} joints")
        if self.ros2 is not None and len(self.ros2.joints) not in (0, n):
            raise ValueError(f"ros2.joints has {len(self.ros2.joints)} entries for {n} joints")
        return self


class WorldConfig(Model):
    """A simulated scene recipe (`sim/worlds/<name>.yaml`)."""

    name: str
    description: str
    kind: Literal["packed", "pile", "adversarial"]
    count: int = Field(gt=0, le=30)
    scale_min: Positive = 1.0
    scale_max: Positive = 1.0
    view: Literal["side"] = "side"
    noise: Literal["gamma", "gaussian", "none"] = "gamma"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.scale_min > self.scale_max:
            raise ValueError(f"scale_min {self.scale_min} is above scale_max {self.scale_max}")
        return self
