"""Without any extra: the program runs in simulation, and says what is missing where it is needed."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXTRAS = ("pyrealsense2", "pylibfranka", "rclpy", "viser", "mcap", "matplotlib", "rosidl_generator_py")
"""What the extras bring; nothing of it can be imported in these tests."""
HIDE = f"""
import importlib.util
import sys

found = importlib.util.find_spec

def find_spec(name, package=None):
    return None if name.partition(".")[0] in {EXTRAS!r} else found(name, package)

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {EXTRAS!r}:
            raise ModuleNotFoundError(f"No module named '{{name}}' (hidden)", name=name)

importlib.util.find_spec = find_spec
sys.meta_path.insert(0, Hidden())
"""


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A folder to work in; every Python that starts there lacks the extras."""
    (tmp_path / "hide").mkdir()
    (tmp_path / "hide" / "sitecustomize.py").write_text(HIDE)
    return tmp_path


def evg_app(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    path = os.pathsep.join([str(folder / "hide"), str(ROOT)])
    given = {"env": os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"}, "timeout": 200}
    command = [sys.executable, "-m", "evg_app.cli.main", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, **given)


@pytest.mark.slow
def test_a_round_in_simulation_needs_no_extra(bare: Path):
    scene = (ROOT / "sim" / "worlds" / "packed.yaml").read_text()
    (bare / "sim" / "worlds").mkdir(parents=True)
    (bare / "sim" / "worlds" / "packed.yaml").write_text(re.sub(r"count: .*", "count: 1", scene))
    words = ["--sim", "--model", "antipodal", "--json", str(bare / "out.json"), "--run-dir", str(bare / "run")]
    done = evg_app(bare, "run", *words)
    assert done.returncode == 0, done.stderr
    assert json.loads((bare / "out.json").read_text())["rounds"] == 1
    for words, extra in ((["view"], "viewer"), (["trials", "export", "--mcap", "run.mcap"], "export")):
        done = evg_app(bare, *words, str(bare / "run"))
        assert done.returncode == 2 and f"./setup.sh {extra}" in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("words", "package", "extra"),
    [
        (("camera", "list"), "pyrealsense2", "realsense"),
        (("ros", "check", "--robot", "panda"), "rclpy", "ros"),
        (("workspace", "--driver", "ros2"), "rclpy", "ros"),
        (("workspace", "--driver", "fci", "--host", "127.0.0.1"), "pylibfranka", "franka"),
    ],
)
def test_what_is_missing_is_said_where_it_is_needed_with_the_command_that_brings_it(
    bare: Path, words: tuple[str, ...], package: str, extra: str
):
    done = evg_app(bare, *words)
    assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
    assert f"'{package}' is not installed. Run: ./setup.sh {extra}" in done.stderr + done.stdout


def test_the_doctor_lists_every_extra_that_is_not_there(bare: Path):
    done = evg_app(bare, "doctor")
    assert done.returncode == 0 and "evg-app run --sim can run" in done.stdout
    for extra in ("realsense", "franka", "ros", "viewer", "export", "train"):
        assert f"./setup.sh {extra}" in done.stdout, done.stdout
