"""A synthetic session of exact poses, for the mathematics alone; pictures are tested in their own files."""

from dataclasses import replace

import numpy as np
import pytest

from evg_app.geometry import invert, make
from evg_app.handeye.boards import load_board
from evg_app.handeye.refine import project_all
from evg_app.handeye.rigid import exp
from evg_app.handeye.sample import Views
from evg_app.types import Intrinsics


@pytest.fixture(scope="session")
def board():
    return load_board("charuco_a4")


@pytest.fixture(scope="session")
def lens():
    return Intrinsics(848, 480, 426.678, 426.678, 427.25, 234.44, (-0.05, 0.03, 5e-4, -4e-4, 0.0))


@pytest.fixture(scope="session")
def synthetic(board, lens):
    """(views, X, Z) of N random views; `turns` bounds the rotation vector per axis [rad], `noise` is in pixels."""

    def build(count=16, turns=(0.35, 0.35, 0.35), noise=0.0, seed=0, scale=1.0):
        rng = np.random.default_rng(seed)
        X = make(exp(rng.normal(0, 1, 3)), rng.normal(0, 0.5, 3))
        Z = make(exp(rng.normal(0, 1, 3)), rng.normal(0, 0.1, 3))
        B = []
        for _ in range(count):
            R = exp(rng.normal(0, 1, 3) * turns)
            B.append(make(R, np.array([0, 0, 0.5]) + rng.normal(0, 0.05, 3) - R @ board.center))
        B = np.stack(B)
        A, n = X @ B @ invert(Z), len(board.points)
        views = Views(
            A,
            B,
            np.repeat(np.arange(count), n),
            np.tile(board.points, (count, 1)),
            np.zeros((count * n, 2)),
            np.arange(count),
            lens,
        )
        pixels = project_all(views, X, Z, scale)[1]
        return replace(views, pixels=pixels + rng.normal(0, noise, pixels.shape)), X, Z

    return build
