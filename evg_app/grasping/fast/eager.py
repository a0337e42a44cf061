"""Encoder and heads as the networks' own methods, for accelerators, where torch is at home."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from evg_app.geometry import GRID_SIZE
from evg_app.grasping.fast.field import lattice_of
from evg_app.grasping.fast.heads import Place
from evg_app.nets.equigiga import EquiGIGA
from evg_app.nets.equiigd import EquiIGD
from evg_app.nets.features import Features
from evg_app.nets.rotation import from_rows


class EagerEncoder:
    """The network's backbone on its device."""

    def __init__(self, net: EquiIGD | EquiGIGA, device: torch.device) -> None:
        self._net, self._device = net, device

    def __call__(self, values: NDArray[np.float32]) -> Tensor:
        """See `Encoder`."""
        grid = torch.tensor(values, device=self._device)[None, None]
        with torch.backends.cudnn.flags(enabled=True, benchmark=False, deterministic=True, allow_tf32=False):
            return self._net.encode(grid).planes[:, 0].contiguous()


class EagerHeads:
    """See `Heads`."""

    def __init__(self, net: EquiIGD | EquiGIGA) -> None:
        self._net = net

    @property
    def regresses(self) -> bool:
        """See `Heads`."""
        return isinstance(self._net, EquiGIGA) or self._net.rotation_head is not None

    def graspness(self, place: Place) -> Tensor:
        """See `Heads`."""
        return self._net.graspness(_features(place), _points(place))[0]

    def grasps(self, place: Place, noise: Tensor, steps: int) -> tuple[Tensor, Tensor, Tensor]:
        """See `Heads`."""
        features, points = _features(place), _points(place)
        width = self._net.width(features, points)[0]
        if isinstance(self._net, EquiGIGA):
            rotation = self._net.rotation(features, points)
            return rotation, torch.ones((*rotation.shape[:2], 1), device=rotation.device), width
        context = self._net.rotation_context(features, points)
        candidates = [self._net.sample_from_context(context, noise, steps)] if len(noise) else []
        if self._net.rotation_head is not None:
            candidates.append(from_rows(self._net.regress_from_context(context)))
        rotation = torch.cat(candidates)
        scores = [self._net.grasp_scores(features, points, one[None])[0] for one in rotation]
        return rotation, torch.stack(scores).sigmoid_(), width


def _features(place: Place) -> Features:
    """The field as the networks' methods take it."""
    n, channels = GRID_SIZE, place.field.channels
    return Features(place.field.table.view(3, 1, n, n, channels))


def _points(place: Place) -> Tensor:
    """Shape (1, N, 3)."""
    pixels = lattice_of(place.side).pixels.to(place.index.device)[place.index, :3]
    return ((pixels + 0.5) / GRID_SIZE - 0.5)[None]
