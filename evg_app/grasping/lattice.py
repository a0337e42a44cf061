"""Where the networks are asked: voxel centres, centres of 2x2x2 blocks, and the flow's noise at each.

All of it turns with the scene: the lattices are symmetric about the workspace's centre, and the noise of
a voxel is that of its image in the first quadrant, turned with it.
"""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import GRID_SIZE, VOXEL_SIZE, Array

BLOCKS = GRID_SIZE // 2
"""Coarse lattice points along each side: one per block of 2 voxels. (A lattice of every second voxel centre
would not be symmetric about the centre.)"""

_FROM_CENTRE = np.abs(np.arange(BLOCKS) - (BLOCKS - 1) / 2).astype(np.intp)
_EVEN = _FROM_CENTRE % 2 == 0
SEEDS = _EVEN[:, None, None] & _EVEN[:, None] & (np.arange(BLOCKS) % 2 == 0)
"""Blocks that are asked first: every second along each side, mirrored about the centre. Shape (20, 20, 20)."""

Indices = NDArray[np.intp]
Value = TypeVar("Value", bound=np.generic)


def voxel_points(index: Indices) -> NDArray[np.float32]:
    """Voxel centres in units of the cube, centred, in [-0.5, 0.5]. Flat indices (N,) -> (N, 3)."""
    ijk = np.stack(np.unravel_index(index, (GRID_SIZE,) * 3), axis=-1)
    return ((ijk + 0.5) / GRID_SIZE - 0.5).astype(np.float32)


def voxel_positions(index: Indices) -> Array:
    """Voxel centres in the task frame [m]. Flat indices (N,) -> (N, 3)."""
    positions: Array = (np.stack(np.unravel_index(index, (GRID_SIZE,) * 3), axis=-1) + np.float64(0.5)) * VOXEL_SIZE
    return positions


def block_points(index: Indices) -> NDArray[np.float32]:
    """Block centres in units of the cube, centred. Flat indices into (20, 20, 20), (N,) -> (N, 3)."""
    ijk = np.stack(np.unravel_index(index, (BLOCKS,) * 3), axis=-1)
    return ((ijk + 0.5) / BLOCKS - 0.5).astype(np.float32)


def blocks_with(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Blocks that hold some voxel of the mask. (40, 40, 40) -> (20, 20, 20)."""
    slabs = mask[::2] | mask[1::2]
    bars = slabs[:, ::2] | slabs[:, 1::2]
    return np.asarray(bars[:, :, ::2] | bars[:, :, 1::2])


def block_of(index: Indices) -> Indices:
    """Flat block index of flat voxel indices. Shape (N,)."""
    i, j, k = (axis // 2 for axis in np.unravel_index(index, (GRID_SIZE,) * 3))
    return np.asarray((i * BLOCKS + j) * BLOCKS + k)


def voxels_of(blocks: NDArray[Value]) -> NDArray[Value]:
    """Every voxel with the value of its block, e.g. whether it was chosen. (20, 20, 20) -> (40, 40, 40)."""
    return blocks.repeat(2, axis=0).repeat(2, axis=1).repeat(2, axis=2)


def interpolated(blocks: NDArray[np.float32], where: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Voxels from values at block centres, cubic (Keys 1981), of those blocks `where` there is one; in [0, 1].

    Shape (20, 20, 20) -> (40, 40, 40).
    """
    share = where.astype(np.float32)
    both = np.stack([blocks * share, share])
    value, weight = along_axes(_CUBIC, both)
    return np.asarray(np.clip(value / np.maximum(weight, np.float32(0.1)), 0.0, 1.0))


def along_axes(matrix: NDArray[np.float32], cubes: NDArray[np.float32]) -> NDArray[np.float32]:
    """A map (M, N) of lines, applied along all axes of cubes (..., N, N, N). (..., M, M, M).

    Each product is so small that BLAS computes it on this thread: its own threads spin for 30 ms after a larger one,
    on a core that the plan's other thread could use.
    """
    along_x = (matrix @ cubes.swapaxes(-3, -2)).swapaxes(-3, -2)
    return np.asarray(matrix @ along_x @ matrix.T)


def _cubic() -> NDArray[np.float32]:
    """Weights of blocks for the voxels along one side; the outermost block goes on for ever. Shape (40, 20)."""
    quarter = np.array([-9.0, 111.0, 29.0, -3.0]) / 128.0  # Keys, a quarter after the second of four
    matrix = np.zeros((GRID_SIZE, BLOCKS))
    for voxel in range(GRID_SIZE):
        block, after = divmod(voxel, 2)
        for place, weight in zip(range(-1, 3), quarter, strict=True):
            matrix[voxel, np.clip(block + (place if after else -place), 0, BLOCKS - 1)] += weight
    return matrix.astype(np.float32)


_CUBIC = _cubic()


def rotation_noise(index: Indices, samples: int, seed: int) -> NDArray[np.float32]:
    """The flow's N(0, 1) start at voxels: a function of seed and voxel that turns with the scene.

    Rows of the 2x3 block of a rotation turn as vectors: after a quarter turn (row1, row2) is (-row2, row1).

    Args:
        index: flat voxel indices. Shape (N,).
        samples: draws S per voxel.
        seed: any int.

    Returns:
        Six numbers in row order. Shape (S, N, 6).
    """
    half = GRID_SIZE // 2
    i, j, k = np.unravel_index(index, (GRID_SIZE,) * 3)
    turns = np.select([(i >= half) & (j >= half), (i < half) & (j >= half), (i < half) & (j < half)], [0, 1, 2], 3)
    x, y = i - half, j - half  # cells of the first quadrant: 0 .. 19; their quarter turn is (x, y) -> (-1 - y, x)
    home_x = np.select([turns == 0, turns == 1, turns == 2], [x, y, -1 - x], -1 - y)
    home_y = np.select([turns == 0, turns == 1, turns == 2], [y, -1 - x, -1 - y], x)
    noise = _normal((home_x * half + home_y) * GRID_SIZE + k, samples, seed)
    row1, row2, turn = noise[..., :3], noise[..., 3:], turns[:, None]
    first = np.select([turn == 0, turn == 1, turn == 2], [row1, -row2, -row1], row2)
    second = np.select([turn == 0, turn == 1, turn == 2], [row2, row1, -row2], -row1)
    return np.concatenate([first, second], axis=-1)


def _normal(cell: Indices, samples: int, seed: int) -> NDArray[np.float32]:
    """Six N(0, 1) numbers for each sample and cell number, without drawing those of all other cells. (S, N, 6)."""
    count = np.arange(samples)[:, None, None] * GRID_SIZE**3 + cell[None, :, None]
    counter = (count * 3 + np.arange(3)).astype(np.uint64)
    bits = _mixed(_mixed(np.full((), abs(seed), dtype=np.uint64)) + counter)
    low, high = bits & np.uint64(0xFFFFFFFF), bits >> np.uint64(32)
    radius = np.sqrt(-2.0 * np.log((low + 1.0) * 2.0**-32))
    angle = high * (2.0 * np.pi * 2.0**-32)
    pairs = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    return pairs.reshape(samples, len(cell), 6).astype(np.float32)


def _mixed(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """SplitMix64 (Steele, Lea, Flood 2014): neighbouring numbers become unrelated ones."""
    with np.errstate(over="ignore"):
        x = x * np.uint64(0x9E3779B97F4A7C15) + np.uint64(0x9E3779B97F4A7C15)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return np.asarray(x ^ (x >> np.uint64(31)))
