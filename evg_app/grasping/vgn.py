"""VGN's planner with an official checkpoint, for comparison."""

from pathlib import Path
from typing import Self

import numpy as np
import torch

from evg_app.geometry import GRID_SIZE, Array
from evg_app.grasping import published
from evg_app.grasping.planner import torch_device
from evg_app.grasping.protocol import Grid, grid_values
from evg_app.nets.vgn import VGN
from evg_app.types import Grasps


class VgnPlanner:
    """Asks every voxel at once; a voxel's grasp is at its lower corner."""

    name = "vgn"
    training_azimuth = published.SIDE_AZIMUTH

    def __init__(self, net: VGN, weights_sha256: str = "", device: str = "cpu") -> None:
        self._device = torch_device(device)
        self._net = net.eval().to(self._device)
        self.weights_sha256 = weights_sha256

    @classmethod
    def load(cls, weights: Path, device: str = "cpu") -> Self:
        """With an official `vgn_*.pt`.

        Raises:
            WeightsError: the file is missing or not such a checkpoint.
            BadInput: torch does not have the device.
        """
        net = VGN()
        digest = published.load_checkpoint(net, weights)
        return cls(net, digest, device)

    def plan(self, grid: Grid, seed: int = 0) -> Grasps:
        """Ranked grasps, best first; see `Planner.plan`. No random numbers are used."""
        values = grid_values(grid)
        valid = published.valid_mask(values)
        if not valid.any():
            return Grasps.empty()
        with torch.inference_mode():
            answers = self._net(torch.tensor(values, device=self._device)[None, None])
        quality, rotation, voxels = (part[0].cpu().numpy() for part in answers)
        widths: Array = voxels.ravel().astype(np.float64) / GRID_SIZE
        index, score, width = published.select(quality, valid, lambda where: widths[where])
        quaternion: Array = rotation.reshape(4, -1)[:, index].T.astype(np.float64)
        return published.as_grasps(index, quaternion, width, score)
