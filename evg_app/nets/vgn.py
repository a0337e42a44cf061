"""VGN (Breyer et al. 2020), a baseline; its modules bear the official checkpoints' names (spec §2.8)."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn


class VGN(nn.Module):
    """Quality, rotation and width at every voxel of a grid. 313,238 parameters."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = Encoder()
        self.decoder = Decoder()
        self.conv_qual = nn.Conv3d(16, 1, 5, padding=2)
        self.conv_rot = nn.Conv3d(16, 4, 5, padding=2)
        self.conv_width = nn.Conv3d(16, 1, 5, padding=2)

    def forward(self, grid: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Answers for TSDF grids (B, 1, 40, 40, 40).

        Returns:
            Chance of success in [0, 1] (B, 40, 40, 40), unit quaternion xyzw (B, 4, 40, 40, 40) and
            opening in voxels (B, 40, 40, 40).
        """
        x = self.decoder(self.encoder(grid))
        quality = torch.sigmoid(self.conv_qual(x))[:, 0]
        return quality, F.normalize(self.conv_rot(x), dim=1), self.conv_width(x)[:, 0]


class Encoder(nn.Module):
    """Three strided convolutions, 40 to 5 voxels a side."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv3d(1, 16, 5, stride=2, padding=2)
        self.conv2 = nn.Conv3d(16, 32, 3, stride=2, padding=1)
        self.conv3 = nn.Conv3d(32, 64, 3, stride=2, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        """(B, 1, 40, 40, 40) -> (B, 64, 5, 5, 5)."""
        for conv in (self.conv1, self.conv2, self.conv3):
            x = F.relu(conv(x))
        return x


class Decoder(nn.Module):
    """Three convolutions, each followed by a resize, 5 to 40 voxels a side."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv3d(64, 64, 3, padding=1)
        self.conv2 = nn.Conv3d(64, 32, 3, padding=1)
        self.conv3 = nn.Conv3d(32, 16, 5, padding=2)

    def forward(self, x: Tensor) -> Tensor:
        """(B, 64, 5, 5, 5) -> (B, 16, 40, 40, 40)."""
        for conv, size in ((self.conv1, 10), (self.conv2, 20), (self.conv3, 40)):
            x = F.interpolate(F.relu(conv(x)), (size, size, size))
        return x
