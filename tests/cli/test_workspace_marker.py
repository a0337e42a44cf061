"""`evg-app workspace --marker`: rendered pictures of a board on a table whose place is known."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "robots" / "fci"))

from calibrated import calibrated

from evg_app.cameras.protocol import ColorImage
from evg_app.cli.main import main
from evg_app.cli.workspace_marker import look
from evg_app.config.calibration import newest_calibration
from evg_app.config.files import load_camera, load_robot
from evg_app.errors import Refused
from evg_app.geometry import Array, invert, look_at, make, rotation_about, transform_points
from evg_app.handeye.boards import load_board
from evg_app.handeye.color import ColorPictures
from evg_app.handeye.rigid import exp
from evg_app.handeye.standin.picture import BoardPainter, Exposure

EXACT_MM = 1.0
"""With a perfect calibration; another one adds its own error at the board and no more."""
PLATE_M = 0.005
SEEDS = 6


class TableCamera:
    """A colour camera beside a table with a board on it; the truth is drawn from a seed."""

    frame_id = "camera_depth_optical_frame"

    def __init__(self, seed: int, tilt_deg: float = 0.2, hidden: bool = False) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.board, self.intrinsics = load_board("charuco_a4"), load_camera("d435i").simulated_intrinsics()
        self.middle = np.array([0.5, 0.0, 0.0]) + rng.uniform(-0.05, 0.05, 3)
        azimuth = rng.uniform(-np.pi, np.pi)
        away = rng.uniform(0.3, 0.4) * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        self.T_base_cam = look_at(self.middle + away + [0.0, 0.0, rng.uniform(0.35, 0.5)], self.middle)
        flat = rotation_about("z", rng.uniform(-np.pi, np.pi))[:3, :3] @ np.diag([1.0, -1.0, -1.0])
        R = exp(np.deg2rad(tilt_deg) * np.array([1.0, 0.0, 0.0])) @ flat
        self.T_base_board = make(R, self.middle + np.array([0.0, 0.0, PLATE_M]) - R @ self.board.center)
        self._painter, self._hidden, self._count = BoardPainter(self.board, self.intrinsics), hidden, 0

    def __enter__(self) -> "TableCamera":
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def capture_color(self, *, after: float, timeout: float) -> ColorImage:
        self._count += 1
        blur = tuple(self.rng.normal(0, 0.2, 2).tolist())
        cover = ((self.intrinsics.cx, self.intrinsics.cy, 400.0),) if self._hidden else ()
        shot = Exposure(0.8, defocus=0.5, motion=blur, hidden=cover, seed=int(self.rng.integers(1 << 31)))
        gray = self._painter.paint(invert(self.T_base_cam) @ self.T_base_board, shot)
        return ColorImage(np.repeat(gray[..., None], 3, axis=2), self.intrinsics, after + 0.1, "color", self._count)


def measured(camera: TableCamera, folder: Path, off: Array | None = None):
    """The table by a calibration that is off by `off` (4, 4)."""
    calibrated(folder, load_camera("d435i"), camera.T_base_cam @ (np.eye(4) if off is None else off))
    calibration, _ = newest_calibration("panda", "d435i", folder)
    return look(ColorPictures(camera), camera.board, calibration, lambda: np.eye(4), lambda what: True, PLATE_M)


def error_mm(table, camera: TableCamera) -> float:
    """Distance of the found workspace's corner from the true one [mm]."""
    return 1e3 * float(np.linalg.norm(table.origin - (camera.middle - [0.15, 0.15, 0.05])))


def calibration_mm(camera: TableCamera, off: Array) -> float:
    """How far a calibration that is off by `off` (4, 4) puts the middle of the square from where it is [mm]."""
    seen = transform_points(invert(camera.T_base_cam), camera.middle)
    return 1e3 * float(np.linalg.norm(transform_points(off, seen) - seen))


def drawn_off(seed: int) -> Array:
    """1 mm and 0.2 degrees about each axis (standard deviations). Shape (4, 4)."""
    rng = np.random.default_rng([seed, 1])
    return make(exp(np.deg2rad(0.2) * rng.standard_normal(3)), 1e-3 * rng.standard_normal(3))


@pytest.mark.slow
def test_the_workspace_is_found_to_millimetres_wherever_camera_and_board_are(tmp_path: Path):
    for seed in range(SEEDS):
        camera, off = TableCamera(seed), drawn_off(seed)
        assert error_mm(measured(camera, tmp_path / f"e{seed}"), camera) < EXACT_MM
        found = error_mm(measured(TableCamera(seed), tmp_path / f"o{seed}", off), camera)
        assert abs(found - calibration_mm(camera, off)) < EXACT_MM


def test_a_board_that_lies_askew_is_refused_with_what_to_do(tmp_path: Path):
    with pytest.raises(Refused, match=r"tilted by 4\.\d degrees.*calibrate verify"):
        measured(TableCamera(3, tilt_deg=4.0), tmp_path)


def test_a_board_that_nobody_sees_is_refused_with_what_to_do(tmp_path: Path):
    with pytest.raises(Refused, match=r"found in 0 of 10 pictures.*camera preview"):
        measured(TableCamera(3, hidden=True), tmp_path)


def test_the_command_writes_the_users_own_file(tmp_path: Path, monkeypatch, capsys):
    camera = TableCamera(5)
    calibrated(tmp_path, load_camera("d435i"), camera.T_base_cam)
    own = tmp_path / "robot_configs" / "panda.yaml"
    own.parent.mkdir()
    own.write_text((Path(__file__).parents[2] / "robot_configs" / "panda.yaml").read_text())
    monkeypatch.setattr("evg_app.cameras.factory.open_camera", lambda *args, **words: camera)
    monkeypatch.setattr("evg_app.cli.operator.Operator.ready", lambda self, question: True)
    words = ["--marker", "charuco_a4", "--plate-mm", str(1e3 * PLATE_M), "--config-dir", str(tmp_path), "--write"]
    assert main(["workspace", "--robot", "panda", *words]) == 0
    assert "table top" in capsys.readouterr().out
    found = np.array(load_robot("panda", tmp_path).T_base_task.xyz_m)
    assert 1e3 * np.linalg.norm(found - (camera.middle - [0.15, 0.15, 0.05])) < EXACT_MM


def test_without_a_calibration_the_command_that_makes_one_is_named(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("evg_app.config.files.shipped_folder", lambda: Path(__file__).parents[2])
    assert main(["workspace", "--marker", "charuco_a4", "--config-dir", str(tmp_path)]) == 3
    assert "evg-app calibrate" in capsys.readouterr().err


def main_numbers(count: int, target: Path) -> None:
    """Errors over many seeds, for the docs."""
    import tempfile

    errors: dict[str, list[float]] = {"exact": [], "off": [], "of_the_calibration": []}
    for seed in range(100, 100 + count):
        for name, off in (("exact", None), ("off", drawn_off(seed))):
            camera = TableCamera(seed)
            with tempfile.TemporaryDirectory() as folder:
                errors[name].append(error_mm(measured(camera, Path(folder), off), camera))
        errors["of_the_calibration"].append(calibration_mm(camera, drawn_off(seed)))
    target.write_text(json.dumps({"command": f"tests/cli/test_workspace_marker.py {count} OUT.json", **errors}) + "\n")


if __name__ == "__main__":
    main_numbers(int(sys.argv[1]), Path(sys.argv[2]))
