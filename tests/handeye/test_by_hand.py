"""`--manual`: a scripted hand guides the simulated arm and presses the keys; pictures are shown in between."""

import argparse
import os
import sys

import numpy as np
import pytest

from evg_app.cli import calibrate_bench
from evg_app.errors import BadInput
from evg_app.geometry import make
from evg_app.handeye.by_hand import collect_by_hand
from evg_app.handeye.poses import Reach
from evg_app.handeye.rigid import exp
from evg_app.handeye.solve import solve
from evg_app.handeye.standin.judge import true_errors

POSES = 15
TRUE_MM, TRUE_DEG = 3.0, 0.5


def lab_of(mode, seed):
    """A stand-in lab."""
    words = argparse.Namespace(robot="panda", camera="d435i", board="charuco_a4", config_dir=None, seed=seed)
    return calibrate_bench.simulated(words, mode, lambda sample, frame: None)


@pytest.fixture(scope="module")
def lab():
    return lab_of("eye-in-hand", 3)


class Person:
    """Guides the arm by hand to views of the board, looks twice at the picture, presses Enter, and q at the end."""

    def __init__(self, lab):
        self.world, self.reach = lab.bench.clock, Reach(lab.bench.motion)
        self.start, self.left, self.looks = lab.truth.q_start, POSES, 0
        self.hand = lab.bench.motion.kinematics.fk_hand(self.start)
        self.rng = np.random.default_rng(1)

    def guide(self):
        """The arm is pushed to another pose around the first one."""
        q = None
        while q is None:
            turn = self.rng.uniform(-1, 1, 3) * (0.35, 0.35, 0.6)
            q = self.reach.configuration(self.hand @ make(exp(turn), self.rng.uniform(-0.06, 0.06, 3)), self.start)
        self.world.arrive(q)

    def key(self):
        """What the person does next."""
        self.looks = (self.looks + 1) % 3
        if self.looks == 1:
            self.guide()
        if self.looks:
            return None
        self.left -= 1
        return "" if self.left >= 0 else "q"


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["eye-to-hand", "eye-in-hand"])
def test_a_person_who_guides_the_arm_gets_a_good_calibration(mode):
    lab, seen = lab_of(mode, 3), []
    session = collect_by_hand(lab.bench, Person(lab).key, lambda sample, frame: seen.append(sample.number))
    solution = solve(session)
    assert len(session.samples) == POSES and len(seen) == 2 * (POSES + 1)
    mm, deg = true_errors(lab.truth, lab.bench.motion.kinematics, solution.fit.X)
    assert solution.verdict == "go", solution.reasons
    assert mm < TRUE_MM and deg < TRUE_DEG and mm < solution.uncertainty.bound_mm


@pytest.fixture
def keyboard(monkeypatch):
    """The other end of standard input."""
    read, write = os.pipe()
    with os.fdopen(read) as stdin, os.fdopen(write, "w", buffering=1) as keys:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield keys


def test_enter_takes_a_sample_and_the_end_of_input_ends(lab, keyboard, capsys):
    keyboard.write("\n")
    shown = []

    def preview(sample, frame):
        """Press Enter at the first look, and go away at the second."""
        shown.append(sample.number)
        keyboard.write("\n") if len(shown) == 1 else keyboard.close()

    session = calibrate_bench.by_hand(lab.bench, preview)
    assert [sample.number for sample in session.samples] == [0, 1]
    assert shown == [1, 2] and len(session.usable()) == 2


def test_no_sample_at_all_is_said(lab, keyboard, capsys):
    keyboard.write("q\n")
    with pytest.raises(BadInput, match="no sample was taken"):
        calibrate_bench.by_hand(lab.bench, lambda sample, frame: None)
