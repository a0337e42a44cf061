"""The window says what is missing, and the arm is drawn where kinematics puts it."""

import sys

import numpy as np
import pytest

from evg_app.cli.main import main
from evg_app.config.files import load_robot
from evg_app.errors import MissingExtra
from evg_app.motion.kinematics import Kinematics
from evg_app.viewer.arm import ArmMeshes
from evg_app.viewer.window import Window

POSE_ATOL = 1e-6
"""Drawn against computed [m]."""


@pytest.fixture(scope="module")
def robot():
    return load_robot("panda")


def test_without_viser_the_extra_is_named(robot, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingExtra, match=r"\./setup\.sh viewer"):
        Window(robot, port=0)


def test_the_hand_is_drawn_where_kinematics_puts_it(robot):
    arm, q = ArmMeshes(robot), np.asarray(robot.home_q_rad)
    T_base_hand = Kinematics(robot).fk_hand(q)
    hand = next(i for i, name in enumerate(arm.names) if "hand" in name)
    assert arm.poses(q)[hand] == pytest.approx(T_base_hand, abs=POSE_ATOL)
    assert arm.tool_path(np.stack([q, q]))[1] == pytest.approx(T_base_hand[:3, 3], abs=POSE_ATOL)


def test_every_part_of_the_arm_has_a_shape_of_its_size(robot):
    arm = ArmMeshes(robot)
    assert len(arm.names) == len(set(arm.names)) == len(arm.meshes) > 8
    sizes = [np.ptp(vertices, axis=0).max() for vertices, _ in arm.meshes]
    assert min(sizes) > 0.001 and max(sizes) < 0.5, "metres, not millimetres"


def test_a_folder_without_a_run_is_refused(tmp_path, capsys):
    assert main(["view", str(tmp_path)]) == 2
    assert str(tmp_path) in capsys.readouterr().err


@pytest.mark.parametrize("port", ["-1", "70000", "web"])
def test_a_port_that_cannot_be_is_refused(port):
    with pytest.raises(SystemExit):
        main(["view", "--port", port])
