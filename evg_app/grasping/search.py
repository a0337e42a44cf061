"""Where graspness is asked when not everywhere: coarse to fine, and what is taken for it between the answers.

1. At the centres of `lattice.SEEDS`, every eighth block of 2x2x2 voxels. 2. At the centres of those other blocks whose
surroundings promise most. 3. At the voxels of the best blocks. Every step is symmetric under turns about z.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import GRID_SIZE
from evg_app.grasping import lattice, selection

Ask = Callable[[NDArray[np.intp], int], NDArray[np.float32]]
"""Graspness in [0, 1] at flat indices into a lattice of so many points a side."""


def coarse_to_fine(
    mask: selection.Mask, ask: Ask, refined: int, blocks: int
) -> tuple[selection.Volume, lattice.Indices]:
    """Graspness of the candidates.

    Args:
        mask: candidate voxels. Shape (40, 40, 40).
        ask: the network.
        refined: blocks that are asked in step 2.
        blocks: best blocks of step 3.

    Returns:
        What is known or guessed of graspness (40, 40, 40), and the candidates that were asked, flat indices.
    """
    near = lattice.blocks_with(mask)
    values, asked = np.zeros(near.shape, dtype=np.float32), np.zeros_like(near)

    def learn(index: lattice.Indices) -> None:
        """Ask blocks."""
        np.put(values, index, ask(index, lattice.BLOCKS))
        np.put(asked, index, True)

    learn(np.flatnonzero(near & lattice.SEEDS))
    promise = selection.filled(values, asked) + selection.largest_around(values)
    others = np.flatnonzero(near & ~asked)
    learn(others[selection.best(promise.ravel()[others], refined)])
    known = np.flatnonzero(asked)
    chosen = np.zeros_like(near)
    np.put(chosen, known[selection.best(values.ravel()[known], blocks)], True)
    volume = lattice.interpolated(selection.filled(values, asked), near)
    fine = np.flatnonzero(mask & lattice.voxels_of(chosen))
    np.put(volume, fine, ask(fine, GRID_SIZE))
    return volume, fine
