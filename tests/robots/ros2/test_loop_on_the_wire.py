"""The loop itself on an arm behind ROS 2 actions in another process, and what it logs when the wire misbehaves."""

import json
import os
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from ros2_lab import SETTINGS, pick
from ros2_peer import PeerProcess, fresh_domain, isolate

from evg_app.events import Event, MotionStarted, StopReason
from evg_app.grasping.load import load_planner
from evg_app.picking.run import RunResult

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SPEED = "3"
"""The peer's physics runs this much faster than real time where the computer can; holding an object is costly."""
ONE_PASS = SETTINGS.__class__(motion_slack=SETTINGS.motion_slack, max_attempts=1, close_after_contact=False)


@pytest.fixture(scope="module")
def table() -> Iterator[PeerProcess]:
    isolate()
    kept = os.environ["ROS_DOMAIN_ID"]
    os.environ["ROS_DOMAIN_ID"] = fresh_domain()
    peer = PeerProcess("--speed", SPEED, "--objects", "1")
    yield peer
    peer.close()
    os.environ["ROS_DOMAIN_ID"] = kept


def once(
    peer: PeerProcess, folder: Path, name: str, hurt: Callable[[], object], with_referee: bool = True
) -> RunResult:
    """One pass; when the motion of that name starts, it is hurt."""

    def listen(event: Event) -> None:
        if isinstance(event, MotionStarted) and event.name == name:
            hurt()

    return pick(peer, load_planner("antipodal", None, "cpu"), folder, 0, 1, listen, with_referee, ONE_PASS)


def rows(folder: Path) -> list[dict]:
    connection = sqlite3.connect(folder / "trials.sqlite")
    connection.row_factory = sqlite3.Row
    return [dict(row) for row in connection.execute("select * from attempts")]


def complete(row: dict) -> bool:
    return None not in [row[key] for key in ("outcome", "failure", "evidence", "motion_s", "compute_ms", "arrays")]


def test_a_pass_runs_to_its_end_and_every_sign_is_in_its_row(table: PeerProcess, tmp_path: Path):
    table.ask("home")
    result = once(table, tmp_path / "run", "nothing", lambda: None)
    assert result.error is None and result.rounds[0].stop_reason in (StopReason.ATTEMPT_LIMIT, StopReason.CLEARED)
    (row,) = rows(tmp_path / "run")
    assert complete(row) and row["outcome"] in ("success", "failure")
    evidence = json.loads(row["evidence"])
    assert evidence["width_closed"] is not None and evidence["width_lifted"] is not None
    assert evidence["in_bin_after"] == (1 if row["outcome"] == "success" else 0)
    assert table.wire("grasp") == ["0.0000 30.0"]


def test_contact_on_the_approach_stops_it_backs_off_and_is_logged_as_such(table: PeerProcess, tmp_path: Path):
    table.ask("home")
    push = {"wrench": [0.0, 0.0, 60.0, 0.0, 0.0, 0.0]}
    result = once(table, tmp_path / "run", "approach", lambda: table.ask("fault", push))
    assert result.error is None
    (row,) = rows(tmp_path / "run")
    assert complete(row) and row["failure"] == "contact on approach"
    assert json.loads(row["evidence"])["contact"] is True
    assert len(table.wire("cancel")) == 1 and table.wire("grasp") == []


def test_torque_of_any_size_is_no_contact(table: PeerProcess, tmp_path: Path):
    table.ask("home")
    twist = {"wrench": [0.0, 0.0, 0.0, 60.0, 60.0, 60.0]}
    once(table, tmp_path / "run", "approach", lambda: table.ask("fault", twist))
    (row,) = rows(tmp_path / "run")
    assert row["failure"] != "contact on approach" and len(table.wire("grasp")) == 1


def test_motion_that_the_controller_aborts_is_a_logged_failure(table: PeerProcess, tmp_path: Path):
    table.ask("home")
    result = once(table, tmp_path / "run", "reach", lambda: table.ask("fault", {"abort_after": 0.3}))
    (row,) = rows(tmp_path / "run")
    assert complete(row) and row["outcome"] == "failure"
    assert result.rounds[0].stop_reason in (StopReason.ERROR, StopReason.ATTEMPT_LIMIT)


def test_robot_that_dies_in_mid_motion_ends_the_run_with_a_complete_row_and_the_next_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("ROS_DOMAIN_ID", fresh_domain())
    peer = PeerProcess("--speed", SPEED, "--objects", "1")
    try:
        result = once(peer, tmp_path / "run", "reach", peer.kill, with_referee=False)
    finally:
        peer.close()
    assert result.rounds[0].stop_reason is StopReason.ERROR
    assert "Run: ros2 launch" in result.rounds[0].detail
    (row,) = rows(tmp_path / "run")
    assert complete(row) and row["outcome"] == "failure" and row["failure"] == "device error"
    connection = sqlite3.connect(tmp_path / "run" / "trials.sqlite")
    warned = [json.loads(data) for (data,) in connection.execute("select data from events where kind = 'Warned'")]
    assert any("Run: ros2 launch" in event["text"] for event in warned)
