"""`evg-app run` on hardware, without any: what is refused before anything moves, and a whole run on a strict peer."""

import json
import os
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "robots" / "fci"))

from calibrated import calibrated
from fci_motions import rests
from fci_peers import PEERS, Peer, franka_sim, robot_at, tool_pose_of
from lab_files import lab_files

from evg_app.cli.main import main
from evg_app.config.files import load_camera, load_robot
from evg_app.geometry import invert, look_at
from evg_app.robots.fci.arm import FciArm
from evg_app.types import ArmMode

T_BASE_CAM = look_at((0.5, -0.55, 0.4), (0.5, 0.0, 0.05))
STOPPED_S = 30.0
"""From a stop file to the end of the program with its report, on a busy machine; the arm stops in below 0.5 s."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    """An empty working directory: no calibration of anybody else is found."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("evg_app.config.files.shipped_folder", lambda: Path(__file__).parents[2])
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], words: list[str], code: int = 3) -> str:
    """Run; demand the exit code and a single line without a traceback. Returns that line."""
    assert main(["run", "--model", "antipodal", *words]) == code
    message = capsys.readouterr().err.strip()
    assert "Traceback" not in message and len(message.splitlines()) == 1
    return message


def test_without_a_calibration_nothing_starts(capsys, folder: Path):
    message = refused(capsys, ["--robot", "panda", "--camera", "d435i"])
    assert "evg-app calibrate --robot panda --camera d435i" in message
    assert not (folder / "runs").exists()


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"verdict": "refuse", "reasons": ("too few poses",)}, "too few poses"),
        ({"created_utc": datetime.now(UTC) - timedelta(days=400)}, "days old"),
        ({"camera_frame": "other"}, "camera frame"),
    ],
)
def test_a_calibration_that_cannot_be_trusted_is_refused(capsys, folder: Path, changes, why):
    calibrated(folder, load_camera("d435i"), T_BASE_CAM, **changes)
    message = refused(capsys, ["--config-dir", str(folder)])
    assert why in message and "evg-app calibrate" in message


def test_an_inverted_calibration_is_refused(capsys, folder: Path):
    from evg_app.config.calibration import pose_of

    calibrated(folder, load_camera("d435i"), T_BASE_CAM, T_parent_cam=pose_of(invert(T_BASE_CAM)))
    assert "inverted" in refused(capsys, ["--config-dir", str(folder)])


@pytest.mark.parametrize(
    "words", [["--dry-run"], ["--step"], ["--driver", "fci"], ["--confirm-speed", "0.5"], ["--host", "x"]]
)
def test_hardware_options_do_not_go_with_sim(capsys, folder: Path, words):
    assert words[0] in refused(capsys, ["--sim", *words], code=2)


@pytest.mark.parametrize("speed", ["0", "1.5", "-1", "fast"])
def test_an_impossible_speed_is_exit_2(capsys, speed):
    with pytest.raises(SystemExit) as caught:
        main(["run", "--confirm-speed", speed])
    assert caught.value.code == 2


def test_a_robot_without_a_tool_box_is_refused(capsys, folder: Path):
    shipped = (Path(__file__).parents[2] / "robot_configs" / "panda.yaml").read_text()
    begin = shipped.index("tool_box:")
    end = shipped.index("\n\n", begin)
    (folder / "robot_configs").mkdir()
    (folder / "robot_configs" / "panda.yaml").write_text(shipped[:begin] + shipped[end:])
    assert "tool_box" in refused(capsys, ["--config-dir", str(folder)])


def start(folder: Path, host: str, *words: str) -> "subprocess.Popen[str]":
    """`evg-app run` over the FCI on stored frames."""
    root = Path(__file__).parents[2]
    return subprocess.Popen(
        [
            *(sys.executable, "-m", "evg_app.cli.main", "run", "--robot", "panda", "--model", "antipodal"),
            *("--driver", "fci", "--host", host, "--camera", f"replay/{folder / 'frames'}"),
            *("--config-dir", str(folder), "--run-dir", str(folder / "run"), *words),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(root), "OMP_NUM_THREADS": "1"},
    )


def wait_for(program: "subprocess.Popen[str]", word: str) -> str:
    """Read what a program says up to a line with this word."""
    assert program.stdout is not None
    said = ""
    for line in program.stdout:
        said += line
        if word in line:
            return said
    raise AssertionError(f"'{word}' never came: {said}")


def at_rest(peer: Peer) -> bool:
    """Whether the arm, asked by a new client, is idle and stays where it is."""
    robot = robot_at(peer.host)
    with FciArm(robot, tool_pose_of(robot)) as arm:
        state = arm.state()
        away = np.abs(state.q - np.array(load_robot("panda").look_q_rad)).max() > 0.05
        return state.mode is ArmMode.IDLE and rests(arm) and bool(away)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_dry_run_and_then_a_stop_on_a_strict_peer(tmp_path: Path):
    lab_files(tmp_path)
    peer = PEERS["franka-sim"]()
    try:
        with start(tmp_path, peer.host, "--dry-run", "--json", str(tmp_path / "dry.json")) as dry:
            said, _ = dry.communicate(timeout=200)
        assert dry.returncode == 0, said
        assert "transport: " in said and "would be sent" in said and "NOT a safety function" in said, said
        assert "speed 0.1 of the configured limits" in said
        assert json.loads((tmp_path / "dry.json").read_text())["attempts"] == 0

        (tmp_path / "run").rename(tmp_path / "dry")
        with start(tmp_path, peer.host, "--step") as stopped:
            assert "look: " in wait_for(stopped, "Go?")
            assert stopped.stdin is not None
            stopped.stdin.write("y\n")
            stopped.stdin.flush()
            time.sleep(2.0)
            (tmp_path / "run" / "STOP").touch()
            asked = time.monotonic()
            said, _ = stopped.communicate(timeout=60)
        assert stopped.returncode == 130, said
        assert time.monotonic() - asked < STOPPED_S
        assert at_rest(peer)

    finally:
        peer.close()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_picks_run_over_the_franka_interface_and_nothing_that_speaks_against_them_is_a_success(tmp_path: Path):
    """The peer's hand stops at 40 mm whenever it closes, above the bin too, and the replayed picture never changes."""
    lab_files(tmp_path)
    peer = franka_sim("--loose")
    try:
        with start(tmp_path, peer.host, "--confirm-speed", "1", "--json", str(tmp_path / "out.json")) as running:
            said, _ = running.communicate(timeout=200)
        assert running.returncode == 0, said
        facts = json.loads((tmp_path / "out.json").read_text())
        assert facts["attempts"] == 2 and facts["stop_reasons"] == {"two consecutive failures": 1}, said
        assert facts["failure_reasons"] == {"still in the hand": 2}, said
        assert said.count("the place did not change, the opening 40.0 mm") == 2, said
        assert (tmp_path / "calibration" / "panda-speed.yaml").exists()
        devices = json.loads((tmp_path / "run" / "run.json").read_text())["provenance"]["devices"]
        assert devices["arm"]["driver"] == "fci" and devices["arm"]["pylibfranka"]
        assert devices["camera"]["driver"] == "replay" and devices["gripper"]["server version"]
    finally:
        peer.close()
