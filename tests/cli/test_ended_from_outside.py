"""Real processes ended from outside, by a closed terminal or SIGTERM: nothing goes on, nothing is lost."""

import json
import os
import pty
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

COMMAND = [sys.executable, "-m", "evg_app.cli.main"]
PATIENCE_S = 120.0


def until(happened, what: str) -> None:
    """Wait for something."""
    deadline = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline, f"{what} did not come"
        time.sleep(0.05)


def living(group: int) -> list[str]:
    """Command lines of the processes of a group that are no zombies."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            state, _, its_group = (folder / "stat").read_text().rpartition(")")[2].split()[:3]
            if int(its_group) == group and state != "Z":
                found.append((folder / "cmdline").read_text())
        except (FileNotFoundError, ProcessLookupError):
            continue
    return found


def ended(folder: Path) -> str:
    """How the run ended by its log, in which every attempt has an outcome."""
    log = sqlite3.connect(folder / "trials.sqlite")
    assert log.execute("SELECT count(*) FROM attempts WHERE outcome IS NULL").fetchone() == (0,)
    (status,) = log.execute("SELECT status FROM runs").fetchone()
    return str(status)


@pytest.mark.slow
def test_a_run_whose_terminal_is_closed_ends_in_order(tmp_path: Path):
    folder = tmp_path / "run"
    process, terminal = pty.fork()
    if process == 0:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # whoever runs the tests may ignore it
        os.execv(
            COMMAND[0], [*COMMAND, "run", "--sim", "--rounds", "50", "--model", "antipodal", "--run-dir", str(folder)]
        )
    said = b""
    while b"pass 0" not in said:
        said += os.read(terminal, 4096)
    os.close(terminal)
    until(lambda: os.waitpid(process, os.WNOHANG)[0] == process, "the end of the run")
    assert ended(folder) == "stopped by the user"


@pytest.mark.slow
def test_a_run_that_nobody_hears_ends_after_the_attempt(tmp_path: Path):
    words = ["run", "--sim", "--rounds", "50", "--model", "antipodal", "--run-dir", str(tmp_path / "run")]
    json_path = tmp_path / "run.json"
    process = subprocess.Popen([*COMMAND, *words, "--json", str(json_path)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    while b"pass 0" not in process.stdout.readline():
        pass
    process.stdout.close()
    process.wait(PATIENCE_S)
    assert ended(tmp_path / "run") == "stopped by the user"
    assert json.loads(json_path.read_text())["attempts"] >= 1


@pytest.mark.slow
def test_killed_generation_leaves_no_worker_behind(tmp_path: Path):
    words = ["generate", "--out", str(tmp_path / "data"), "--scenes", "200", "--workers", "2"]
    process = subprocess.Popen([*COMMAND, *words], start_new_session=True, stderr=subprocess.PIPE)
    try:
        until(lambda: sum("spawn_main" in line for line in living(process.pid)) == 2, "two workers")
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 130
        assert process.stderr is not None and b"stopped by the user" in process.stderr.read()
        until(lambda: not living(process.pid), "the end of the workers")
    finally:
        if living(process.pid):
            os.killpg(process.pid, signal.SIGKILL)
