"""The doctor finds what is wrong and says what mends it."""

import json
from pathlib import Path

from evg_app.cli import doctor
from evg_app.cli.main import main


def test_every_finding_that_is_not_ok_says_what_mends_it():
    for finding in doctor.findings():
        assert finding.status == "ok" or finding.mend, finding


def test_missing_extra_is_a_note_with_its_command(monkeypatch):
    monkeypatch.setattr(doctor, "EXTRAS", {"ros": ("no_such_module_anywhere", "the robot over ROS 2")})
    (finding,) = doctor.check_extras()
    assert (finding.status, finding.mend) == ("note", "Run: ./setup.sh ros")


def test_missing_core_package_is_a_fault_and_exit_2(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "CORE", ("no_such_module_anywhere",))
    monkeypatch.setattr(doctor, "CHECKS", (doctor.check_core,))
    assert main(["doctor"]) == 2
    assert "./setup.sh" in capsys.readouterr().out


def test_check_that_breaks_is_itself_a_fault(monkeypatch):
    def broken():
        raise RuntimeError("disk on fire")

    monkeypatch.setattr(doctor, "CHECKS", (broken,))
    (finding,) = doctor.findings()
    assert finding.status == "fault"
    assert "disk on fire" in finding.detail


def test_missing_library_names_its_debian_package(monkeypatch):
    monkeypatch.setattr(doctor, "LIBRARIES", {"libnone.so.9": "libnone9"})
    assert [f.mend for f in doctor.check_libraries()] == ["Run: sudo apt-get install libnone9"]


def test_json_lists_the_findings(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(doctor, "CHECKS", (doctor.check_python,))
    assert main(["doctor", "--json", str(tmp_path / "d.json")]) == 0
    assert json.loads((tmp_path / "d.json").read_text())[0]["check"] == "python"
