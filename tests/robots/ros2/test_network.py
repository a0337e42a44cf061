"""What is said about middleware, domain and discovery range, and where interface packages come from."""

import os
import sys

import pytest

from evg_app.errors import BadInput, MissingExtra
from evg_app.robots.ros2 import build, interfaces
from evg_app.robots.ros2.network import network

PYTHON = f"python{sys.version_info.major}.{sys.version_info.minor}"


def test_defaults_are_those_of_ros():
    setting = network({})
    assert (setting.rmw, setting.domain, setting.discovery) == ("rmw_fastrtps_cpp", "0", "SUBNET")
    assert not setting.faults
    assert any("communication_constraints_violation" in note for note in setting.notes)
    assert "ROS_DOMAIN_ID 0" in str(setting)


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({"ROS_DOMAIN_ID": "seven"}, "export ROS_DOMAIN_ID=0"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "PLANET"}, "none of SUBNET"),
        ({"PYTHONPATH": "/opt/ros/jazzy/lib/python2.7/site-packages"}, "another Python"),
    ],
)
def test_what_cannot_work_is_a_fault_with_advice(environment: dict[str, str], words: str):
    assert words in network(environment).faults[0]


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({"ROS_DOMAIN_ID": "150"}, "above 101"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "off"}, "ROS_STATIC_PEERS"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, "only this computer"),
        ({"ROS_LOCALHOST_ONLY": "1"}, "deprecated"),
    ],
)
def test_what_surprises_is_a_note(environment: dict[str, str], words: str):
    assert any(words in note for note in network(environment).notes)


def test_the_same_ros_python_is_no_fault():
    assert not network({"PYTHONPATH": f"/opt/ros/jazzy/lib/{PYTHON}/site-packages"}).faults


def test_without_rclpy_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(MissingExtra, match=r"setup\.sh ros"):
        interfaces.rclpy()


def test_without_the_package_the_build_command_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(interfaces, "rclpy", lambda: None)
    with pytest.raises(BadInput, match=r"evg-app ros build.*ros-jazzy-nobody-msgs"):
        interfaces.interface.__wrapped__("nobody_msgs.action", "Nothing")


def test_without_the_generators_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path):
    monkeypatch.setattr(build, "build_folder", lambda: tmp_path / "none")
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setitem(os.environ, "AMENT_PREFIX_PATH", "")
    with pytest.raises(MissingExtra, match=r"setup\.sh ros"):
        build.build(lambda text: None)


def test_every_built_package_has_definitions():
    for package in interfaces.DEPENDENCIES:
        assert list((interfaces.DEFINITIONS / package).rglob("*.*")), package
