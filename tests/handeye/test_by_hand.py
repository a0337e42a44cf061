"""`--manual`: a sample at each Enter until q."""

import argparse

import pytest

from evg_app.cli import calibrate_bench
from evg_app.errors import BadInput


@pytest.fixture(scope="module")
def bench():
    words = argparse.Namespace(robot="panda", camera="d435i", board="charuco_a4", config_dir=None, seed=3)
    return calibrate_bench.simulated(words, "eye-in-hand", lambda sample, frame: None).bench


def test_each_enter_takes_a_sample(bench, monkeypatch, capsys):
    answers = iter(["", "", "q"])
    monkeypatch.setattr("builtins.input", lambda: next(answers))
    session = calibrate_bench.by_hand(bench)
    assert [sample.number for sample in session.samples] == [0, 1]
    assert len(session.usable()) == 2


def test_no_sample_at_all_is_said(bench, monkeypatch, capsys):
    monkeypatch.setattr("builtins.input", lambda: "q")
    with pytest.raises(BadInput, match="no sample was taken"):
        calibrate_bench.by_hand(bench)
