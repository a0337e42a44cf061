"""The `ros2` section of a robot's YAML file: every name on the wire, and how long to wait for it."""

from typing import Literal, Self

from pydantic import model_validator

from evg_app.config.base import Model, Positive


class Ros2Gripper(Model):
    """A gripper over ROS 2.

    `franka` uses the three actions of franka_gripper, `gripper_command` one control_msgs/GripperCommand action whose
    position is `position_per_width` times the opening (a Franka Hand counts ONE finger: 0.5).
    """

    kind: Literal["franka", "gripper_command"] = "franka"
    homing_action: str = "/franka_gripper/homing"
    move_action: str = "/franka_gripper/move"
    grasp_action: str = "/franka_gripper/grasp"
    command_action: str = "/franka_gripper/gripper_action"
    stop_service: str = "/franka_gripper/stop"
    position_per_width: Positive = 0.5
    joint_states: str = "/franka_gripper/joint_states"
    finger_joints: tuple[str, ...]
    width_per_position: Positive = 1.0
    state_timeout_s: Positive = 1.0


class Ros2Recovery(Model):
    """The three ordered steps after a reflex (franka_ros2 3.3 and newer); an empty name leaves its step out."""

    error_recovery_action: str = "/action_server/error_recovery"
    hardware_service: str = "/controller_manager/set_hardware_component_state"
    hardware_component: str = "FrankaHardwareInterface"
    switch_service: str = "/controller_manager/switch_controller"
    controllers: tuple[str, ...] = ()


class Ros2Model(Model):
    """The robot over ROS 2.

    Attributes:
        joints: names on the wire, in the order of the robot's own `joints`; the robot's own names when empty.
        arm_action, arm_topic: of the joint_trajectory_controller; the topic is used without control_msgs.
        robot_state: franka_msgs/FrankaRobotState (mode, errors, external force); empty without one.
        wrench: geometry_msgs/WrenchStamped in the base frame, used before the one in `robot_state`; empty without one.
        stop_topic: std_msgs/Empty; any message asks the run to stop.
        start_arm, start_gripper: what a person types to start the servers; shown when they are missing.
    """

    joints: tuple[str, ...] = ()
    arm_action: str
    arm_topic: str
    joint_states: str = "/joint_states"
    robot_state: str = ""
    wrench: str = ""
    stop_topic: str = "/evg_app/stop"
    gripper: Ros2Gripper
    recovery: Ros2Recovery | None = None
    start_arm: str
    start_gripper: str
    server_timeout_s: Positive = 10.0
    accept_timeout_s: Positive = 2.0
    cancel_timeout_s: Positive = 1.0
    state_timeout_s: Positive = 0.5
    feedback_timeout_s: Positive = 1.0
    start_tolerance_rad: Positive = 0.02
    rest_rad_s: Positive = 0.02
    settle_s: Positive = 1.0

    @model_validator(mode="after")
    def _absolute(self) -> Self:
        names = {"arm_action": self.arm_action, "arm_topic": self.arm_topic, "joint_states": self.joint_states}
        for key, name in names.items():
            if not name.startswith("/"):
                raise ValueError(f"{key} must be a full name that starts with '/', is '{name}'")
        return self
