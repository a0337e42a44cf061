"""A new robot is slow until a person has confirmed more."""

from pathlib import Path

import pytest

from evg_app.config.speed import FIRST_SPEED, confirm_speed, confirmed_speed
from evg_app.errors import ConfigError


def test_a_new_robot_starts_at_a_tenth(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert confirmed_speed("panda") == FIRST_SPEED == 0.1


def test_a_confirmation_is_remembered_for_its_robot_only(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert confirm_speed("panda", 0.5) == tmp_path / "calibration" / "panda-speed.yaml"
    assert confirmed_speed("panda") == 0.5
    assert confirmed_speed("fr3") == FIRST_SPEED


def test_a_broken_confirmation_is_an_error_not_full_speed(tmp_path: Path):
    confirm_speed("panda", 0.5, tmp_path)
    path = tmp_path / "calibration" / "panda-speed.yaml"
    path.write_text(path.read_text().replace("0.5", "5.0"))
    with pytest.raises(ConfigError, match="speed_share"):
        confirmed_speed("panda", tmp_path)
