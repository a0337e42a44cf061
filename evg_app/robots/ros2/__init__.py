"""The robot over ROS 2 (rclpy): `open_robot` gives the arm and the gripper."""

from evg_app.robots.ros2.open import Ros2Robot, open_robot

__all__ = ["Ros2Robot", "open_robot"]
