"""Shared scenes: a random TSDF-like grid, query points, grasps and flow noise, and how they turn."""

from dataclasses import dataclass

import pytest
import torch
from torch import Tensor

from evg_app.nets.rotation import from_rows, to_rows, turn_scene


def turn_rotation(rotation: Tensor, turns: int) -> Tensor:
    """Rz(90 deg)^turns R."""
    return turn_scene(rotation.transpose(-1, -2), turns).transpose(-1, -2)


def turn_rows(rows: Tensor, turns: int) -> Tensor:
    """Six numbers in row order after the turn, whether orthonormal or not."""
    block = torch.cat([rows.reshape(*rows.shape[:-1], 2, 3), rows.new_zeros(*rows.shape[:-1], 1, 3)], -2)
    return to_rows(turn_rotation(block, turns))


@dataclass(frozen=True)
class Scene:
    grid: Tensor
    points: Tensor
    rotation: Tensor
    noise: Tensor

    def turned(self, turns: int) -> "Scene":
        return Scene(
            torch.rot90(self.grid, turns, (2, 3)),
            turn_scene(self.points, turns),
            turn_rotation(self.rotation, turns),
            turn_rows(self.noise, turns),
        )


@pytest.fixture(scope="session", autouse=True)
def one_thread():
    torch.set_num_threads(1)


@pytest.fixture(autouse=True)
def seeded():
    """Networks initialise from torch's generator: start it alike in each test and put it back after."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        yield


@pytest.fixture
def scene() -> Scene:
    g = torch.Generator().manual_seed(3)
    grid = torch.rand(2, 1, 40, 40, 40, generator=g) * (torch.rand(2, 1, 40, 40, 40, generator=g) > 0.7)
    points = (torch.rand(2, 60, 3, generator=g) - 0.5) * 1.1
    rotation = from_rows(torch.randn(2, 60, 6, generator=g))
    return Scene(grid, points, rotation, torch.randn(2, 60, 6, generator=g))


@pytest.fixture
def turn():
    """The functions that turn rotations and rows, for tests."""
    return {"rotation": turn_rotation, "rows": turn_rows}


@pytest.fixture
def randomised():
    """Fills every parameter with random numbers of its own scale, biases and encodings included."""

    def fill(net: torch.nn.Module, seed: int = 0) -> torch.nn.Module:
        g = torch.Generator().manual_seed(seed)
        with torch.no_grad():
            for p in net.parameters():
                scale = p.std() if p.numel() > 1 and p.std() > 0 else 0.1
                p.add_(torch.randn(p.shape, generator=g) * scale).mul_(0.7)
        return net

    return fill
