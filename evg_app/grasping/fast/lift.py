"""The lifted volume's means, computed only where the grid is not zero around a voxel (a fifth of it, typically).

Elsewhere the lifted value is the same for all voxels, relu(bias): `LiftAndProject` without most of its work.
"""

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from evg_app.geometry import GRID_SIZE
from evg_app.grasping import columns
from evg_app.nets.lift import LiftAndProject

_SIDE = GRID_SIZE + 2
_PLANES = ((0, 1), (0, 2), (1, 2))
"""Coordinates (row, column) of the xy, xz and yz plane."""


class SparseLift:
    """Means of the lifted volume of one grid along z, y and x, from a trained `LiftAndProject`."""

    def __init__(self, lift: LiftAndProject) -> None:
        kernel = lift.filter.expand().detach()[:, 0]  # (C, x, y, z)
        self._weight = kernel.flatten(1).T.contiguous()
        self._bias = lift.bias.expand().detach().clone()
        self._empty = self._bias.clamp(min=0.0)
        window = np.arange(3)
        self._window = torch.from_numpy(((window[:, None, None] * _SIDE + window[:, None]) * _SIDE + window).ravel())
        ijk = np.stack(np.unravel_index(np.arange(GRID_SIZE**3), (GRID_SIZE,) * 3))
        self._corner = torch.from_numpy(np.array([_SIDE * _SIDE, _SIDE, 1]) @ ijk)
        self._cells = [(ijk[row] * GRID_SIZE + ijk[column]).astype(np.int16) for row, column in _PLANES]

    def __call__(self, values: NDArray[np.float32]) -> Tensor:
        """Grid (40, 40, 40) to planes xy, xz and yz (3, 40, 40, C), axes in this order of coordinates."""
        padded = np.zeros((_SIDE,) * 3, dtype=np.float32)
        padded[1:-1, 1:-1, 1:-1] = values
        near = np.flatnonzero(columns.with_neighbours(values != 0.0))
        corner = self._corner[torch.from_numpy(near)]  # of each voxel's window in the padded grid
        patches = (
            torch.from_numpy(padded)
            .view(-1)
            .index_select(0, (corner[:, None] + self._window).view(-1))
            .view(-1, len(self._window))
        )
        lifted = torch.addmm(self._bias, patches, self._weight).relu_().sub_(self._empty)
        planes = [self._sums(lifted, cells[near]) for cells in self._cells]
        return torch.stack(planes).mul_(1.0 / GRID_SIZE).add_(self._empty).view(3, GRID_SIZE, GRID_SIZE, -1)

    def _sums(self, lifted: Tensor, cell: NDArray[np.int16]) -> Tensor:
        """Sums of the rows (M, C) of each cell of a plane. (1600, C)."""
        order = np.argsort(cell, kind="stable")
        ends = np.cumsum(np.bincount(cell, minlength=GRID_SIZE**2))
        starts = np.concatenate([[0], ends[:-1]])
        return F.embedding_bag(torch.from_numpy(order), lifted, torch.from_numpy(starts), mode="sum")
