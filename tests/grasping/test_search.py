"""Coarse to fine asks little, finds what is there, and turns with the scene."""

import numpy as np
import pytest

from evg_app.grasping import lattice, selection
from evg_app.grasping.load import load_planner
from evg_app.grasping.search import coarse_to_fine

VALUE_TOLERANCE = 1e-5
SMOOTH_TOLERANCE = 0.02
"""Of interpolation, for a hill 16 voxels wide and 1 high."""
REFINED, BLOCKS = 256, 48


def hill(points, top):
    """A smooth graspness with one top, at points in units of the cube."""
    return np.exp(-((points - top) ** 2).sum(-1) / (2 * 0.2**2)).astype(np.float32)


def asking(top, asked):
    """The network's answers for `hill`; what is asked is kept."""

    def ask(index, side):
        points = lattice.voxel_points(index) if side == 40 else lattice.block_points(index)
        asked.append((side, index))
        return hill(points, top)

    return ask


@pytest.fixture
def mask():
    """Candidates: a slab of a third of the cube."""
    mask = np.zeros((40, 40, 40), bool)
    mask[3:37, 3:37, 8:24] = True
    return mask


@pytest.mark.parametrize("top", [(0.1, -0.2, -0.1), (-0.31, 0.3, 0.05)])
def test_the_best_voxel_is_found_with_a_twentieth_of_the_questions(mask, top):
    asked = []
    volume, fine = coarse_to_fine(mask, asking(np.array(top), asked), REFINED, BLOCKS)
    truth = hill(lattice.voxel_points(np.arange(64_000)), np.array(top)).reshape(40, 40, 40)
    assert np.argmax(np.where(mask, volume, 0)) == np.argmax(np.where(mask, truth, 0))
    assert sum(len(index) for _, index in asked) < mask.sum() / 10
    assert all(len(np.unique(index)) == len(index) for _, index in asked)
    assert mask.ravel()[fine].all() and np.array_equal(volume.ravel()[fine], truth.ravel()[fine])


def test_the_search_turns_with_the_scene(mask):
    top = np.array([0.12, -0.2, -0.1])
    volume, _ = coarse_to_fine(mask, asking(top, []), REFINED, BLOCKS)
    turned, _ = coarse_to_fine(mask, asking(np.array([-top[1], top[0], top[2]]), []), REFINED, BLOCKS)
    assert np.abs(np.rot90(volume, axes=(0, 1)) - turned).max() < VALUE_TOLERANCE


def test_seeds_are_an_eighth_and_symmetric():
    assert lattice.SEEDS.sum() == 1_000
    assert np.array_equal(np.rot90(lattice.SEEDS, axes=(0, 1)), lattice.SEEDS)


def test_interpolation_keeps_constants_and_follows_smooth_values():
    everywhere = np.ones((20, 20, 20), bool)
    flat = lattice.interpolated(np.full((20, 20, 20), 0.4, np.float32), everywhere)
    assert np.abs(flat - 0.4).max() < VALUE_TOLERANCE
    top = np.array([0.05, 0.1, 0.0])
    guess = lattice.interpolated(hill(lattice.block_points(np.arange(8_000)), top).reshape(20, 20, 20), everywhere)
    truth = hill(lattice.voxel_points(np.arange(64_000)), top).reshape(40, 40, 40)
    assert np.abs(guess - truth).max() < SMOOTH_TOLERANCE
    assert guess.flags.c_contiguous, "it is written to through a flat view"


def test_unknown_blocks_are_filled_from_known_ones_around_them():
    values, known = np.zeros((20, 20, 20), np.float32), np.zeros((20, 20, 20), bool)
    values[4, 4, 4], values[4, 4, 6], known[4, 4, 4], known[4, 4, 6] = 0.2, 0.8, True, True
    filled = selection.filled(values, known)
    assert filled[4, 4, 4] == np.float32(0.2) and filled[4, 4, 5] == pytest.approx(0.5)
    assert selection.largest_around(values)[5, 5, 5] == np.float32(0.8) and filled[15, 15, 15] == 0.0


def test_the_dense_reference_has_a_name():
    dense, fast = load_planner("equiigd-dense"), load_planner("equiigd")
    assert dense.config.dense and not fast.config.dense and dense.weights_sha256 == fast.weights_sha256
