"""Bad input to `evg-app run` ends in one clear line and exit 2, before anything moves."""

from pathlib import Path

import pytest

from evg_app.cli.main import main
from evg_app.config.files import shipped_folder

SIM = ["run", "--sim", "--model", "antipodal"]


def refused(capsys: pytest.CaptureFixture[str], words: list[str], code: int = 2) -> str:
    """Run; demand the exit code and a single line without a traceback. Returns that line."""
    assert main(words) == code
    message = capsys.readouterr().err.strip()
    assert message.startswith(f"evg-app {words[0]}: ")
    assert "Traceback" not in message
    assert len(message.splitlines()) == 1
    return message


def test_unknown_robot_lists_the_known_ones(capsys):
    assert "available: fr3, panda" in refused(capsys, [*SIM, "--robot", "ur5"])


def test_unknown_scene_lists_the_known_ones(capsys):
    assert "packed, pile" in refused(capsys, [*SIM, "--scene", "kitchen"])


def test_unknown_model_lists_the_known_ones(capsys):
    assert "equiigd" in refused(capsys, ["run", "--sim", "--model", "gpt"])


def test_unknown_yaml_key_names_file_and_line(capsys, tmp_path: Path):
    (tmp_path / "robot_configs").mkdir()
    text = (shipped_folder() / "robot_configs" / "panda.yaml").read_text() + "extra_key: 1\n"
    (tmp_path / "robot_configs" / "panda.yaml").write_text(text)
    message = refused(capsys, [*SIM, "--config-dir", str(tmp_path)])
    assert f"panda.yaml:{len(text.splitlines())}:" in message
    assert "extra_key" in message


def test_missing_weights(capsys, tmp_path: Path):
    message = refused(capsys, ["run", "--sim", "--weights", str(tmp_path / "none.safetensors")])
    assert "none.safetensors" in message


def test_corrupt_weights(capsys, tmp_path: Path):
    (tmp_path / "bad.safetensors").write_bytes(b"not a tensor file")
    (tmp_path / "bad.json").write_text("{}")
    assert "bad" in refused(capsys, ["run", "--sim", "--weights", str(tmp_path / "bad.safetensors")])


def test_empty_objects_folder(capsys, tmp_path: Path):
    assert str(tmp_path) in refused(capsys, [*SIM, "--objects", str(tmp_path)])


def test_broken_mesh_is_named(capsys, tmp_path: Path):
    (tmp_path / "thing.urdf").write_text(
        '<robot name="thing"><link name="thing">'
        '<inertial><mass value="0.1"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial>'
        '<visual><geometry><mesh filename="thing_visual.obj"/></geometry></visual>'
        '<collision><geometry><mesh filename="thing_collision.obj"/></geometry></collision></link></robot>'
    )
    for role in ("visual", "collision"):
        (tmp_path / f"thing_{role}.obj").write_text("this is no mesh\n")
    assert "thing_" in refused(capsys, [*SIM, "--objects", str(tmp_path)])


def test_run_folder_that_exists_is_never_overwritten(capsys, tmp_path: Path):
    (tmp_path / "keep.txt").write_text("mine")
    assert "not empty" in refused(capsys, [*SIM, "--run-dir", str(tmp_path)])
    assert (tmp_path / "keep.txt").read_text() == "mine"


def test_run_folder_that_cannot_be_made(capsys, tmp_path: Path):
    """A file where a folder is needed: refused for root too, unlike a read-only folder."""
    (tmp_path / "file").write_text("")
    assert "cannot be written" in refused(capsys, [*SIM, "--run-dir", str(tmp_path / "file" / "run")])


def test_json_target_without_a_folder(capsys, tmp_path: Path):
    assert "cannot be written" in refused(capsys, [*SIM, "--json", str(tmp_path / "no" / "out.json")])


@pytest.mark.parametrize("words", [["--rounds", "0"], ["--rounds", "x"], ["--speed", "0"], ["--nonsense"]])
def test_malformed_options_are_exit_2(capsys, words):
    with pytest.raises(SystemExit) as caught:
        main([*SIM, *words])
    assert caught.value.code == 2
