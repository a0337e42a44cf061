"""EquiGIGA: graspness, regressed rotation, width and occupancy from one point feature (spec §2.2).

Points p are (B, Q, 3) in units of the workspace, centred (see `features`).
"""

from torch import Tensor, nn

from evg_app.nets.config import EquiGIGAConfig
from evg_app.nets.expanded import untie
from evg_app.nets.features import Features, sample
from evg_app.nets.fibres import Fibre
from evg_app.nets.flow import ROTATION
from evg_app.nets.heads import Head
from evg_app.nets.rotation import from_rows, vectors_to_rows
from evg_app.nets.triplane import JointTriUNet


class EquiGIGA(nn.Module):
    """Network of the regressing planner. Build it from a config; see `EquiGIGAConfig`."""

    def __init__(self, config: EquiGIGAConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or EquiGIGAConfig()
        fibre, logit = Fibre(reg=config.reg[0], triv=4 * config.reg[0]), Fibre(triv=1)
        hidden, small = Fibre(reg=config.hidden), Fibre(reg=config.side_hidden)
        self.backbone = JointTriUNet(config.reg, config.side, config.s2tp)
        self.graspness_head = Head(fibre, hidden, logit, config.blocks)
        self.rotation_head = Head(fibre, hidden, ROTATION, config.blocks)
        self.width_head = Head(fibre, small, logit, config.side_blocks)
        self.occupancy_head = Head(fibre, small, logit, config.side_blocks)
        if config.symmetry == "plain":
            untie(self)

    def encode(self, grid: Tensor) -> Features:
        """Features of TSDF grids (B, 1, 40, 40, 40), axes (x, y, z), values as in spec §1."""
        features: Features = self.backbone(grid)
        return features

    def forward(self, grid: Tensor) -> Features:
        """Same as `encode`."""
        return self.encode(grid)

    def graspness(self, features: Features, p: Tensor) -> Tensor:
        """Logit that the grasp predicted at p succeeds. (B, Q)."""
        return self._scalar(self.graspness_head, features, p)

    def width(self, features: Features, p: Tensor) -> Tensor:
        """Opening of the gripper after a grasp at p, fraction of 0.3 m. (B, Q)."""
        return self._scalar(self.width_head, features, p)

    def occupancy(self, features: Features, p: Tensor) -> Tensor:
        """Logit that p is inside an object. (B, Q)."""
        return self._scalar(self.occupancy_head, features, p)

    def regress_rotation(self, features: Features, p: Tensor) -> Tensor:
        """Rotation as six numbers in row order, not orthonormal. (B, Q, 6)."""
        return vectors_to_rows(self.rotation_head(sample(features, p)))

    def rotation(self, features: Features, p: Tensor) -> Tensor:
        """The regressed rotation, orthonormal. (B, Q, 3, 3)."""
        return from_rows(self.regress_rotation(features, p))

    @staticmethod
    def _scalar(head: nn.Module, features: Features, p: Tensor) -> Tensor:
        """One number per point. (B, Q)."""
        out: Tensor = head(sample(features, p))
        return out.squeeze(-1)
