"""`evg-app workspace`: four touches, a report, and the user's own file."""

from pathlib import Path

import numpy as np
import pytest

from evg_app.cli.workspace import measure, own_file, report, write
from evg_app.config.files import load_robot, shipped_folder
from evg_app.errors import BadInput, Stopped

TIPS = [(0.36, -0.14, 0.011), (0.36, 0.16, 0.011), (0.66, 0.16, 0.011), (0.66, -0.14, 0.011)]


def measured():
    left = list(TIPS)
    return measure(lambda: np.array(left.pop(0)), lambda question: True)


def own(folder: Path) -> Path:
    (folder / "robot_configs").mkdir()
    path = folder / "robot_configs" / "panda.yaml"
    path.write_text((shipped_folder() / "robot_configs" / "panda.yaml").read_text())
    return path


def test_the_measured_workspace_is_said_and_written_and_nothing_else_changes(tmp_path: Path, capsys):
    path, before = own(tmp_path), load_robot("panda")
    report(before, measured())
    said = capsys.readouterr().out
    assert "table top 11.0 mm" in said and "+10.0, +10.0, +11.0 mm" in said
    write(path, measured())
    after = load_robot("panda", tmp_path)
    assert after.T_base_task.xyz_m == pytest.approx((0.36, -0.14, -0.039), abs=1e-4)
    assert after.model_copy(update={"T_base_task": before.T_base_task}) == before


def test_the_end_of_the_input_stops_before_anything_is_changed():
    with pytest.raises(Stopped):
        measure(lambda: np.zeros(3), lambda question: False)


def test_the_shipped_config_is_not_written(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput, match="cp "):
        own_file("panda", None)
    assert own_file("panda", own(tmp_path).parents[1]).parent.parent == tmp_path
