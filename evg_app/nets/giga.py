"""GIGA (Jiang et al. 2021), a baseline in plain torch whose modules bear the official checkpoints' names (spec §2.8).

Points p are (B, Q, 3) in units of the workspace, centred, in [-0.5, 0.5].
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

CHANNELS = (32, 64, 128)
"""Of the U-Net's levels."""
HIDDEN, BLOCKS = 32, 5
"""Of the heads."""
EPSILON = 1e-5
"""Shrinks coordinates before planes are sampled."""


class GIGA(nn.Module):
    """Graspness, rotation, width and occupancy at points of one grid. 581,863 parameters."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = PlaneEncoder()
        self.decoder_qual = PointHead(1)
        self.decoder_rot = PointHead(4)
        self.decoder_width = PointHead(1)
        self.decoder_tsdf = PointHead(1)

    def encode(self, grid: Tensor) -> Tensor:
        """Planes xz, xy, yz of TSDF grids. (B, 1, 40, 40, 40) -> (3, B, 32, 40, 40)."""
        planes: Tensor = self.encoder(grid)
        return planes

    def quality(self, planes: Tensor, p: Tensor) -> Tensor:
        """Chance that the grasp predicted at p succeeds, in [0, 1]. (B, Q)."""
        return torch.sigmoid(self.decoder_qual(p, planes)[..., 0])

    def rotation(self, planes: Tensor, p: Tensor) -> Tensor:
        """Unit quaternion xyzw of the grasp at p. (B, Q, 4)."""
        return F.normalize(self.decoder_rot(p, planes), dim=-1)

    def width(self, planes: Tensor, p: Tensor) -> Tensor:
        """Opening, fraction of the workspace. (B, Q)."""
        width: Tensor = self.decoder_width(p, planes)[..., 0]
        return width

    def occupancy(self, planes: Tensor, p: Tensor) -> Tensor:
        """Logit that p is inside an object. (B, Q)."""
        occupied: Tensor = self.decoder_tsdf(p, planes)[..., 0]
        return occupied


class PlaneEncoder(nn.Module):
    """A 3D convolution, means along the axes, and one U-Net for the three planes."""

    def __init__(self) -> None:
        super().__init__()
        self.conv_in = nn.Conv3d(1, CHANNELS[0], 3, padding=1)
        self.unet = UNet()

    def forward(self, grid: Tensor) -> Tensor:
        """Planes xz, xy, yz; rows are the second letter, columns the first. (B, 1, N, N, N) -> (3, B, C, N, N)."""
        x = F.relu(self.conv_in(grid))
        planes = torch.cat([x.mean(axis).transpose(2, 3) for axis in (3, 4, 2)])
        out: Tensor = self.unet(planes)
        return out.view(3, grid.shape[0], *out.shape[1:])


class UNet(nn.Module):
    """Three levels, no normalisation, concatenated skips."""

    def __init__(self) -> None:
        super().__init__()
        first, second, third = CHANNELS
        self.down_convs = nn.ModuleList([Down(first, first), Down(first, second), Down(second, third)])
        self.up_convs = nn.ModuleList([Up(third, second), Up(second, first)])
        self.conv_final = nn.Conv2d(first, first, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(B, 32, H, W) -> (B, 32, H, W)."""
        skips: list[Tensor] = []
        for down in self.down_convs:
            x = down(F.max_pool2d(x, 2) if skips else x)
            skips.append(x)
        skips.pop()
        for up in self.up_convs:
            x = up(x, skips.pop())
        out: Tensor = self.conv_final(x)
        return out


class Down(nn.Module):
    """Two convolutions."""

    def __init__(self, inside: int, outside: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inside, outside, 3, padding=1)
        self.conv2 = nn.Conv2d(outside, outside, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        """(B, inside, H, W) -> (B, outside, H, W)."""
        return F.relu(self.conv2(F.relu(self.conv1(x))))


class Up(nn.Module):
    """A transposed convolution, the skip, two convolutions."""

    def __init__(self, inside: int, outside: int) -> None:
        super().__init__()
        self.upconv = nn.ConvTranspose2d(inside, outside, 2, stride=2)
        self.conv1 = nn.Conv2d(2 * outside, outside, 3, padding=1)
        self.conv2 = nn.Conv2d(outside, outside, 3, padding=1)

    def forward(self, x: Tensor, skip: Tensor) -> Tensor:
        """(B, inside, H, W), (B, outside, 2H, 2W) -> (B, outside, 2H, 2W)."""
        joined = torch.cat([self.upconv(x), skip], 1)
        return F.relu(self.conv2(F.relu(self.conv1(joined))))


class PointHead(nn.Module):
    """Residual blocks on a point's coordinates, fed the planes' features before each."""

    def __init__(self, outputs: int) -> None:
        super().__init__()
        self.fc_c = nn.ModuleList([nn.Linear(3 * CHANNELS[0], HIDDEN) for _ in range(BLOCKS)])
        self.fc_p = nn.Linear(3, HIDDEN)
        self.blocks = nn.ModuleList([Residual() for _ in range(BLOCKS)])
        self.fc_out = nn.Linear(HIDDEN, outputs)

    def forward(self, p: Tensor, planes: Tensor) -> Tensor:
        """(B, Q, 3), (3, B, 32, N, N) -> (B, Q, outputs)."""
        feature = sample_planes(planes, p)
        net = self.fc_p(p)
        for inject, block in zip(self.fc_c, self.blocks, strict=True):
            net = block(net + inject(feature))
        out: Tensor = self.fc_out(F.relu(net))
        return out


class Residual(nn.Module):
    """x + fc_1(relu(fc_0(relu(x)))), fc_1 zero at first."""

    def __init__(self) -> None:
        super().__init__()
        self.fc_0 = nn.Linear(HIDDEN, HIDDEN)
        self.fc_1 = nn.Linear(HIDDEN, HIDDEN)
        nn.init.zeros_(self.fc_1.weight)

    def forward(self, x: Tensor) -> Tensor:
        """(..., 32) -> (..., 32)."""
        out: Tensor = x + self.fc_1(F.relu(self.fc_0(F.relu(x))))
        return out


def sample_planes(planes: Tensor, p: Tensor) -> Tensor:
    """Features of the planes xz, xy, yz at points, concatenated. (3, B, C, N, N), (B, Q, 3) -> (B, Q, 3C)."""
    place = 2.0 * (p / (1.0 + EPSILON))
    features = []
    for plane, axes in zip(planes, ((0, 2), (0, 1), (1, 2)), strict=True):
        at = place[:, :, None, axes]
        found = F.grid_sample(plane, at, mode="bilinear", padding_mode="border", align_corners=True)
        features.append(found[..., 0])
    return torch.cat(features, 1).transpose(1, 2)
