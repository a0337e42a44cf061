"""Config files: every fault is named with its file and line."""

from pathlib import Path

import pytest

from evg_app.config.files import load_camera, load_robot, load_world, shipped_folder
from evg_app.errors import BadInput, ConfigError, UnknownName

ROBOT = (shipped_folder() / "robot_configs" / "panda.yaml").read_text()


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    (tmp_path / "robot_configs").mkdir()
    return tmp_path


def write(lab: Path, text: str) -> int:
    """Write a robot file; returns the line of the marker `# here`."""
    (lab / "robot_configs" / "mine.yaml").write_text(text)
    return next((n for n, line in enumerate(text.splitlines(), 1) if "# here" in line), 0)


def test_shipped_files_read():
    assert len(load_robot("panda").joints) == 7
    assert load_camera("d435i").simulated_intrinsics().width == 848
    assert {load_world(name).kind for name in ("packed", "pile", "adversarial")} == {"packed", "pile", "adversarial"}


def test_unknown_key_is_rejected_with_file_and_line(lab: Path):
    line = write(lab, ROBOT.replace("  speed_m_s: 0.1", "  sped_m_s: 0.1  # here"))
    with pytest.raises(ConfigError) as caught:
        load_robot("mine", lab)
    assert caught.value.line == line
    assert "gripper.sped_m_s" in str(caught.value)
    assert "speed_m_s" in str(caught.value)


def test_missing_key_is_named(lab: Path):
    write(lab, ROBOT.replace("lift_m: 0.15", "").replace("hand_link: panda_hand", ""))
    with pytest.raises(ConfigError, match="'hand_link' is missing"):
        load_robot("mine", lab)


def test_value_of_the_wrong_sign_is_rejected_with_its_line(lab: Path):
    line = write(lab, ROBOT.replace("  force_n: 30.0", "  force_n: -30.0  # here"))
    with pytest.raises(ConfigError) as caught:
        load_robot("mine", lab)
    assert caught.value.line == line


def test_joint_vectors_must_match_the_joints(lab: Path):
    write(lab, ROBOT.replace("home_q_rad: [0.0, ", "home_q_rad: ["))
    with pytest.raises(ConfigError, match="home_q_rad has 6 entries for 7 joints"):
        load_robot("mine", lab)


def test_text_that_is_not_yaml_is_rejected_with_its_line(lab: Path):
    write(lab, "name: [1, 2\nother: 3\n")
    with pytest.raises(ConfigError, match=r"mine\.yaml:\d+: is not valid YAML"):
        load_robot("mine", lab)


def test_unknown_robot_lists_robots_only(lab: Path):
    with pytest.raises(UnknownName) as caught:
        load_robot("ur5", lab)
    assert "panda" in caught.value.known
    assert "d435i" not in caught.value.known


def test_own_folder_comes_first(lab: Path):
    (lab / "robot_configs" / "panda.yaml").write_text(ROBOT.replace("lift_m: 0.15", "lift_m: 0.11"))
    assert load_robot("panda", lab).lift_m == 0.11


def test_config_dir_that_is_no_folder_is_bad_input(lab: Path):
    with pytest.raises(BadInput, match="is not a folder"):
        load_robot("panda", lab / "nowhere")


def test_limits_cannot_be_scaled_up(lab: Path):
    write(lab, ROBOT.replace("velocity_scale: 0.5", "velocity_scale: 1.5"))
    with pytest.raises(ConfigError, match="velocity_scale"):
        load_robot("mine", lab)
