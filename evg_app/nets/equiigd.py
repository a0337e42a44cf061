"""EquiIGD: graspness with deformable attention, rotations by flow matching, a grasp classifier (spec §2).

Points p are (B, Q, 3) in units of the workspace, centred (see `features`); B is the number of
encoded scenes. The methods are the API of training and planning.
"""

from torch import Tensor, nn

from evg_app.nets.attention import DeformableAttention, GraspAttention, NoAttention
from evg_app.nets.config import EquiIGDConfig
from evg_app.nets.expanded import untie
from evg_app.nets.features import Features, sample
from evg_app.nets.fibres import Fibre
from evg_app.nets.flow import ROTATION, RotationFlow
from evg_app.nets.heads import Head
from evg_app.nets.rotation import from_rows, vectors_to_rows
from evg_app.nets.triplane import JointTriUNet

LOGIT = Fibre(triv=1)
"""Type of a logit or width."""


class EquiIGD(nn.Module):
    """Network of the generative planner. Build it from a config; see `EquiIGDConfig`."""

    def __init__(self, config: EquiIGDConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or EquiIGDConfig()
        fibre = Fibre(reg=config.reg[0], triv=4 * config.reg[0])
        hidden, flow = Fibre(reg=config.hidden), Fibre(reg=config.flow_reg, triv=config.flow_triv)
        self.backbone = JointTriUNet(config.reg, config.side, config.s2tp)
        self.graspness_attention = self._attention(fibre)
        self.graspness_head = Head(fibre, hidden, LOGIT, config.blocks)
        self.width_head = Head(fibre, hidden, LOGIT, config.blocks)
        self.occupancy_head = Head(fibre, hidden, LOGIT, config.blocks)
        self.rotation_attention = self._attention(fibre)
        self.flow = RotationFlow(fibre, flow, config.blocks, config.time_dim)
        self.score_attention = GraspAttention(fibre, flow, config.antipodal_score)
        self.score_head = Head(fibre, hidden, Fibre(triv=2) if config.contact_score else LOGIT, config.blocks)
        self.rotation_head = Head(fibre, hidden, ROTATION, config.blocks) if config.regressed_rotation else None
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
        """Logit that a grasp centred at p succeeds for some rotation. (B, Q)."""
        c = sample(features, p)
        return self._scalar(self.graspness_head, self.graspness_attention(features, p, c))

    def width(self, features: Features, p: Tensor) -> Tensor:
        """Opening of the gripper after a grasp at p, fraction of 0.3 m. (B, Q)."""
        return self._scalar(self.width_head, sample(features, p))

    def occupancy(self, features: Features, p: Tensor) -> Tensor:
        """Logit that p is inside an object. (B, Q)."""
        return self._scalar(self.occupancy_head, sample(features, p))

    def rotation_context(self, features: Features, p: Tensor) -> Tensor:
        """Context of the rotation flow at p. (B, Q, C)."""
        c: Tensor = self.rotation_attention(features, p, sample(features, p))
        return c

    def velocity(self, c: Tensor, r_t: Tensor, t: Tensor) -> Tensor:
        """Flow velocity (B, Q, 6) at rotation r_t (B, Q, 6), row order, and time t (B, Q); context c (B, Q, C)."""
        v: Tensor = self.flow(c, r_t, t)
        return v

    def sample_rotation(self, features: Features, p: Tensor, noise: Tensor, steps: int = 10) -> Tensor:
        """Rotations (B, Q, 3, 3) at p from noise (B, Q, 6) ~ N(0, 1)."""
        return self.sample_from_context(self.rotation_context(features, p), noise, steps)

    def sample_from_context(self, c: Tensor, noise: Tensor, steps: int = 10) -> Tensor:
        """`sample_rotation` with the context at hand, e.g. for several samples per point."""
        return self.flow.sample(c, noise, steps)

    def grasp_score(self, features: Features, p: Tensor, rotation: Tensor, allow_contact: bool = False) -> Tensor:
        """Logit that the grasp at p with rotation (B, Q, 3, 3) succeeds. (B, Q).

        With `allow_contact` the approach may touch something (then the fingers close where it stopped); a network
        without a score of its own for that gives the strict one.
        """
        return self.grasp_scores(features, p, rotation)[..., -1 if allow_contact else 0]

    def grasp_scores(self, features: Features, p: Tensor, rotation: Tensor) -> Tensor:
        """Logits of `grasp_score`: strict, and where the network has it with contact allowed. (B, Q, 1 or 2)."""
        c = self.score_attention(features, p, rotation, sample(features, p))
        scores: Tensor = self.score_head(c)
        return scores

    def regress_rotation(self, features: Features, p: Tensor) -> Tensor:
        """One rotation per point as six numbers in row order, not orthonormal (ours). (B, Q, 6)."""
        return self.regress_from_context(self.rotation_context(features, p))

    def regress_from_context(self, c: Tensor) -> Tensor:
        """`regress_rotation` with the context at hand. (B, Q, C) -> (B, Q, 6).

        Raises:
            ValueError: the network was built without this head.
        """
        if self.rotation_head is None:
            raise ValueError("this EquiIGD has no regressed rotation; build it with regressed_rotation=True")
        return vectors_to_rows(self.rotation_head(c))

    def rotation(self, features: Features, p: Tensor) -> Tensor:
        """The regressed rotation, orthonormal. (B, Q, 3, 3)."""
        return from_rows(self.regress_rotation(features, p))

    def _attention(self, fibre: Fibre) -> nn.Module:
        """What looks around a point."""
        config = self.config
        return DeformableAttention(fibre, config.offsets, config.value_reg) if config.eda else NoAttention()

    @staticmethod
    def _scalar(head: nn.Module, c: Tensor) -> Tensor:
        """One number per point. (B, Q, C) -> (B, Q)."""
        out: Tensor = head(c)
        return out.squeeze(-1)
