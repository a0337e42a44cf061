"""`evg-app camera` and `evg-app doctor --camera` on recordings: what they print, write and return."""

import json
import sys
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

sys.path.insert(0, str(Path(__file__).parent.parent / "cameras"))

from recordings import T_TASK_CAM, table_depth, write_recording
from stand_in import Bus

from evg_app.cameras.realsense import connection, devices, sdk
from evg_app.cli.main import main
from evg_app.config.files import load_robot
from evg_app.geometry import to_quaternion

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    image = np.rint(table_depth()).astype(np.uint16)
    return write_recording(tmp_path_factory.mktemp("cli") / "table.db3", [image] * 12)


@pytest.fixture
def bus(monkeypatch, recording, tmp_path):
    """Two cameras on USB, that play the recording."""
    made = Bus([recording]).plug("77", "78")
    monkeypatch.setattr(devices, "USB_DEVICES", tmp_path)
    monkeypatch.setattr(sdk, "load_sdk", lambda: made)
    monkeypatch.setattr(connection, "load_sdk", lambda: made)
    return made


@pytest.fixture
def lab(tmp_path):
    """A config folder with a calibration that puts the camera where the recording was taken."""
    robot = load_robot("panda")
    T_base_cam = robot.T_base_task.matrix() @ T_TASK_CAM
    board = {"xyz_m": [0.0, 0.0, 0.1]}
    (tmp_path / "calibration").mkdir()
    K = {"width_px": 848, "height_px": 480, "fx_px": 426.678, "fy_px": 426.678, "cx_px": 427.25256, "cy_px": 234.44296}
    hands = [robot.T_base_task.matrix() @ step(x, y) for x, y in ((0.1, 0.1), (0.2, 0.1), (0.1, 0.2), (0.2, 0.2))]
    pixels = [project(K, np.linalg.inv(T_base_cam) @ hand @ [0.0, 0.0, 0.1, 1.0]) for hand in hands]
    content = {
        "format": "evg-app hand-eye 1",
        "robot": "panda",
        "camera": "d435i",
        "mode": "eye-to-hand",
        "parent_frame": "panda_link0",
        "camera_frame": "camera_depth_optical_frame",
        "T_parent_cam": pose(T_base_cam),
        "T_other_board": board,
        "created_utc": datetime.now(UTC).isoformat(),
        "verdict": "go",
        "errors": dict.fromkeys(("heldout_mm", "heldout_deg", "bound_mm", "bound_deg", "reprojection_px"), 0.1)
        | {"samples": 20, "rejected": 0},
        "board": "test",
        "board_sha256": "0",
        "intrinsics": K,
        "witnesses": [
            {"T_base_hand": pose(hand), "board_point_m": [0.0, 0.0, 0.0], "pixel": pixel}
            for hand, pixel in zip(hands, pixels, strict=True)
        ],
    }
    (tmp_path / "calibration" / "panda-d435i-x.yaml").write_text(yaml.safe_dump(content))
    return tmp_path


def step(x, y):
    T = np.eye(4)
    T[:3, 3] = (x, y, 0.0)
    return T


def pose(T):
    return {"xyz_m": T[:3, 3].tolist(), "quaternion_xyzw": to_quaternion(T).tolist()}


def project(K, p):
    return [float(K["fx_px"] * p[0] / p[2] + K["cx_px"]), float(K["fy_px"] * p[1] / p[2] + K["cy_px"])]


def test_list_shows_every_camera(bus, capsys):
    assert main(["camera", "list"]) == 0
    out = capsys.readouterr().out
    assert "77" in out and "78" in out and "3.2" in out


def test_list_without_a_camera_says_what_to_do(bus, capsys):
    bus.cameras.clear()
    assert main(["camera", "list"]) == 4
    assert "USB 3 port" in capsys.readouterr().err


def test_udev_prints_commands_with_a_file_that_exists(capsys):
    assert main(["camera", "udev"]) == 0
    path = capsys.readouterr().out.split("'")[1]
    assert 'idVendor}=="8086"' in Path(path).read_text()


def test_preview_writes_colour_and_depth_side_by_side(recording, tmp_path, capsys):
    out = tmp_path / "p.png"
    assert main(["camera", "preview", "--replay", str(recording), "--out", str(out), "--seconds", "0.5"]) == 0
    assert Image.open(out).size == (2 * 848, 480)
    assert "m in the middle" in capsys.readouterr().out


def test_preview_of_one_of_several_cameras(bus, tmp_path):
    out = tmp_path / "p.png"
    assert main(["camera", "preview", "--out", str(out), "--seconds", "0.5"]) == 2
    assert main(["camera", "preview", "--serial", "78", "--out", str(out), "--seconds", "0.5"]) == 0
    assert {serial for serial, _, _ in bus.started} == {"78"}


def test_preview_to_an_unwritable_place_is_bad_input(recording, tmp_path, capsys):
    out = tmp_path / "no" / "p.png"
    assert main(["camera", "preview", "--replay", str(recording), "--out", str(out), "--seconds", "0.5"]) == 2
    assert "--out" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["a.bag", "no/folder/a.db3"])
def test_record_refuses_a_file_that_it_cannot_make(name, tmp_path, capsys):
    assert main(["camera", "record", str(tmp_path / name)]) == 2
    assert ".db3" in capsys.readouterr().err


def test_what_was_recorded_can_be_looked_at(bus, tmp_path, capsys):
    target = tmp_path / "a.db3"
    assert main(["camera", "record", str(target), "--serial", "77", "--seconds", "0.5"]) == 0
    out = capsys.readouterr().out
    assert target.is_file() and f"--replay {target}" in out and "merged frames seen" in out


def test_doctor_judges_a_camera_from_its_link_to_the_table(bus, lab, tmp_path, capsys):
    target = tmp_path / "d.json"
    code = main(["doctor", "--camera", "--serial", "77", "--config-dir", str(lab), "--json", str(target)])
    out = capsys.readouterr().out
    assert code == 0, out
    findings = {f["check"]: f for f in json.loads(target.read_text())}
    assert {"camera link", "camera settings", "camera optics", "camera rate", "camera depth", "camera noise"} <= set(
        findings
    )
    assert findings["camera table"]["status"] == "ok"
    assert "noise 0." in findings["camera table"]["detail"] and "tilt 0." in findings["camera table"]["detail"]
    assert "serial 77" in findings["camera link"]["detail"]


def test_doctor_without_a_calibration_says_which_command_makes_one(recording, tmp_path, capsys):
    (tmp_path / "robot_configs").mkdir()
    assert main(["doctor", "--camera", "--replay", str(recording), "--config-dir", str(tmp_path)]) == 0
    assert "evg-app calibrate" in capsys.readouterr().out


def test_doctor_reports_a_slow_link_as_a_fault(bus, capsys):
    bus.cameras[0].usb = "2.1"
    assert main(["doctor", "--camera", "d435i", "--serial", "77"]) == 4
    assert "USB 3 port" in capsys.readouterr().out


def test_doctor_without_a_camera_says_so_and_fails(bus, capsys):
    bus.cameras.clear()
    assert main(["doctor", "--camera"]) == 4
    out = capsys.readouterr().out
    assert "no RealSense camera" in out and "cannot be used yet" in out
