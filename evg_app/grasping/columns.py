"""Masks of the grid with each column of voxels along z as one 64-bit number: growing them is shifting and joining."""

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import GRID_SIZE

Mask = NDArray[np.bool_]
Columns = NDArray[np.uint64]
"""Bit k of entry (i, j) is voxel (i, j, k). Shape (40, 40)."""


def pack(mask: Mask) -> Columns:
    """Mask (40, 40, 40) to columns."""
    packed = np.zeros((GRID_SIZE, GRID_SIZE, 8), dtype=np.uint8)
    packed[:, :, : GRID_SIZE // 8] = np.packbits(mask, axis=-1, bitorder="little")
    return packed.view("<u8")[:, :, 0]


def unpack(columns: Columns) -> Mask:
    """Columns to mask (40, 40, 40)."""
    bits = np.unpackbits(columns[:, :, None].view(np.uint8), axis=-1, count=GRID_SIZE, bitorder="little")
    return bits.view(np.bool_)


def within(mask: Mask, radius: float) -> Mask:
    """Voxels within `radius` [voxels] of some voxel of the mask, as a distance transform says but much faster."""
    r = int(radius)
    grown = [np.pad(pack(mask), r)]  # by 0, 1, ... voxels up and down
    for h in range(1, r + 1):
        grown.append(grown[-1] | (grown[0] << np.uint64(h)) | (grown[0] >> np.uint64(h)))
    out = np.zeros((GRID_SIZE, GRID_SIZE), dtype=np.uint64)
    for dx in range(r + 1):
        line = np.zeros_like(grown[0][:, :GRID_SIZE])  # what lies at most so far away along y and z
        for dy in range(-r, r + 1):
            rest = radius**2 - dx**2 - dy**2
            if rest >= 0:
                line |= grown[int(rest**0.5)][:, r + dy : r + dy + GRID_SIZE]
        out |= line[r + dx : r + dx + GRID_SIZE] | line[r - dx : r - dx + GRID_SIZE]
    return unpack(out)


def with_neighbours(mask: Mask) -> Mask:
    """Voxels with any of the mask among the 3x3x3 voxels around them."""
    columns = pack(mask)
    columns = np.pad(columns | (columns << np.uint64(1)) | (columns >> np.uint64(1)), 1)
    along_y = columns[:, :-2] | columns[:, 1:-1] | columns[:, 2:]
    return unpack(along_y[:-2] | along_y[1:-1] | along_y[2:])
