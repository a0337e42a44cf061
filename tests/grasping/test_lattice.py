"""The lattices and the flow's noise turn with the scene."""

import numpy as np
import pytest

from evg_app.grasping import lattice

TURN_TOLERANCE = 1e-6
MOMENT_TOLERANCE = 0.02


def turned_indices(index):
    """Flat voxel indices after the scene has turned by +90 degrees about z."""
    i, j, k = np.unravel_index(index, (40, 40, 40))
    return np.ravel_multi_index((39 - j, i, k), (40, 40, 40))


def test_voxel_centres_are_those_of_the_grid():
    index = np.array([0, 63_999, np.ravel_multi_index((1, 2, 3), (40, 40, 40))])
    assert lattice.voxel_positions(index)[0] == pytest.approx([0.00375] * 3)
    assert lattice.voxel_positions(index)[1] == pytest.approx([0.29625] * 3)
    assert lattice.voxel_points(index) == pytest.approx(lattice.voxel_positions(index) / 0.3 - 0.5, abs=1e-6)


def test_both_lattices_are_symmetric_under_quarter_turns():
    for points, n in ((lattice.voxel_points(np.arange(64_000)), 40), (lattice.block_points(np.arange(8_000)), 20)):
        turned = np.stack([-points[:, 1], points[:, 0], points[:, 2]], axis=1)
        cells = np.round((turned + 0.5) * n - 0.5).astype(int)
        assert np.abs((turned + 0.5) * n - 0.5 - cells).max() < 1e-4
        assert len(np.unique(cells, axis=0)) == n**3


def test_blocks_and_their_voxels_fit_together():
    mask = np.zeros((40, 40, 40), bool)
    mask[5, 8, 13] = True
    blocks = lattice.blocks_with(mask)
    assert np.argwhere(blocks).tolist() == [[2, 4, 6]]
    assert lattice.voxels_of(blocks).sum() == 8 and lattice.voxels_of(blocks)[5, 8, 13]
    assert lattice.block_of(np.flatnonzero(mask))[0] == np.flatnonzero(blocks)[0]


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_noise_turns_with_the_scene(turns):
    index = np.random.default_rng(0).choice(64_000, 500, replace=False)
    noise = lattice.rotation_noise(index, 2, seed=5).reshape(2, 500, 2, 3)
    for _ in range(turns):
        index = turned_indices(index)
        noise = np.stack([-noise[:, :, 1], noise[:, :, 0]], axis=2)
    after = lattice.rotation_noise(index, 2, seed=5).reshape(2, 500, 2, 3)
    assert np.abs(after - noise).max() < TURN_TOLERANCE


def test_noise_is_standard_normal_and_depends_on_seed_voxel_and_sample_only():
    index = np.arange(64_000)
    a, b = lattice.rotation_noise(index, 2, 1), lattice.rotation_noise(index, 2, 2)
    assert abs(a.mean()) < MOMENT_TOLERANCE and abs(a.std() - 1) < MOMENT_TOLERANCE
    assert np.abs(a - b).mean() > 0.5 and np.abs(a[0] - a[1]).mean() > 0.5
    assert np.array_equal(lattice.rotation_noise(index[500:510], 2, 1), a[:, 500:510])
