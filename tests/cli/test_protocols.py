"""`run --protocol` and `--resume`: the protocol sets what is run, and an interrupted run goes on at any round."""

import argparse
import sqlite3
from pathlib import Path

import pytest

from evg_app.cli import run as run_verb
from evg_app.cli.main import main
from evg_app.cli.protocols import apply_protocol, facts, world_of
from evg_app.config.files import load_world
from evg_app.errors import BadInput, UnknownName
from evg_app.trials.rows import read_rows
from evg_app.trials.summary import summary

TINY = """
name: tiny
description: one object, two rounds
source: the tests
scene: packed
rounds: 2
objects_per_round: 1
seed: 4
placement: [Put it there.]
"""


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    run_verb.add_parser(parser.add_subparsers())
    return parser.parse_args(["run", "--sim", *words])


def test_a_protocol_sets_scene_rounds_seed_and_count():
    args = parsed("--protocol", "pile-15x5")
    protocol = apply_protocol(args)
    assert (args.scene, args.rounds, args.seeds) == ("pile", 15, (0,))
    assert world_of(load_world(args.scene), protocol).count == 5
    assert facts(protocol)["protocol"]["name"] == "pile-15x5"


def test_without_a_protocol_nothing_changes():
    args = parsed("--rounds", "3")
    assert apply_protocol(args) is None and args.rounds == 3
    world = load_world("packed")
    assert world_of(world, None) is world and facts(None) == {}


@pytest.mark.parametrize("words", [("--rounds", "3"), ("--seed", "1"), ("--scene", "pile")])
def test_what_the_protocol_sets_may_not_be_set_too(words):
    with pytest.raises(BadInput, match=words[0]):
        apply_protocol(parsed("--protocol", "packed-15x5", *words))


def test_an_unknown_protocol_lists_the_known_ones():
    with pytest.raises(UnknownName, match="packed-15x5"):
        apply_protocol(parsed("--protocol", "nope"))


def test_resume_needs_the_folder_to_go_on_with():
    with pytest.raises(BadInput, match="--run-dir"):
        apply_protocol(parsed("--resume"))


def test_a_folder_without_a_log_cannot_be_gone_on_with(tmp_path, capsys):
    words = ["run", "--sim", "--model", "antipodal", "--resume", "--run-dir", str(tmp_path)]
    assert main(words) == 2 and "no trial log" in capsys.readouterr().err


@pytest.mark.slow
def test_an_interrupted_protocol_run_goes_on_with_the_round_that_was_cut_off(tmp_path: Path, capsys):
    (tmp_path / "sim" / "protocols").mkdir(parents=True)
    (tmp_path / "sim" / "protocols" / "tiny.yaml").write_text(TINY)
    folder = tmp_path / "run"
    words = ["run", "--sim", "--model", "antipodal", "--protocol", "tiny"]
    words += ["--config-dir", str(tmp_path), "--run-dir", str(folder)]
    assert main(words) == 0
    first = summary(folder)
    assert (first["rounds"], first["objects"], first["protocol"]) == (2, 2, "tiny")
    db = sqlite3.connect(folder / "trials.sqlite")
    db.execute("UPDATE rounds SET stop_reason = 'stopped by the user' WHERE round_index = 1")
    db.commit()
    db.close()
    assert main([*words, "--resume"]) == 0
    again = summary(folder)
    assert (again["rounds"], again["rounds_begun_again"], again["sessions"]) == (2, 1, 2)
    rows = read_rows(folder)
    assert len({row["run_id"] for row in rows.rounds}) == 2 and "Put it there." in str(rows.runs[0]["config"])
    for name in ("successes", "attempts", "objects"):
        assert again[name] == first[name], "the same seed gives the same round again"
    capsys.readouterr()
    assert main([*words[:3], "random", *words[4:], "--resume"]) == 2
    assert "model (antipodal, now random)" in capsys.readouterr().err
