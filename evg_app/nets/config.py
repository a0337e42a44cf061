"""Architectures as frozen values that go into the card of a weights file."""

from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, Self

from evg_app.nets.triplane import Side

Symmetry = Literal["c4", "plain"]
"""Whether the layers are tied by quarter turns."""


@dataclass(frozen=True)
class NetConfig:
    """What both networks share.

    Attributes:
        side: wiring of the side branch, `exact` (symmetric) or `mixed` (published).
        reg: regular copies at the three levels of the backbone.
        symmetry: `c4`, or `plain`: all layers free, the counterpart to compare with.
        s2tp: whether the side planes join the xy field on the way (without: to measure what that brings).
    """

    side: Side = "exact"
    reg: tuple[int, int, int] = (8, 16, 32)
    symmetry: Symmetry = "c4"
    s2tp: bool = True

    @property
    def reduced(self) -> bool:
        """Whether a part is left out to measure what it brings."""
        return not self.s2tp

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a card, without the name of the network."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The config a card describes.

        Raises:
            ValueError: a key is not known, or a value does not fit.
        """
        known = [f.name for f in fields(cls)]
        unknown = sorted(set(values) - set(known))
        if unknown:
            raise ValueError(f"unknown keys {unknown} in the architecture of {cls.__name__}; known: {known}")
        plain: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        return cls(**plain)


@dataclass(frozen=True)
class EquiGIGAConfig(NetConfig):
    """EquiGIGA (spec §2.2). Sizes are regular copies of the hidden type and numbers of blocks.

    The published code uses `side_hidden=32, side_blocks=5` (937,571 parameters with free filters).
    """

    hidden: int = 32
    blocks: int = 5
    side_hidden: int = 16
    side_blocks: int = 3


@dataclass(frozen=True)
class EquiIGDConfig(NetConfig):
    """EquiIGD (spec §2.2 to §2.6).

    Attributes:
        hidden: regular copies in the heads of graspness, score, width and occupancy.
        blocks: residual blocks of every head.
        flow_reg, flow_triv: hidden type of the rotation flow and of the grasp-conditioned attention.
        time_dim: size of the flow's time embedding.
        offsets: attended points K of the deformable attention.
        value_reg: regular copies of its values.
        antipodal_score: exchange of the fingers leaves the grasp score alone (ours).
        regressed_rotation: adds a regressed rotation as one more candidate (ours, not the paper's).
        contact_score: adds a second grasp score, of succeeding when the fingers may touch on the approach (ours).
        eda: whether graspness and rotation attend to points around them (without: to measure what that brings).
    """

    hidden: int = 16
    blocks: int = 5
    flow_reg: int = 8
    flow_triv: int = 64
    time_dim: int = 16
    offsets: int = 8
    value_reg: int = 24
    antipodal_score: bool = True
    regressed_rotation: bool = True
    contact_score: bool = False
    eda: bool = True

    @property
    def reduced(self) -> bool:
        """See `NetConfig`."""
        return not (self.s2tp and self.eda)


PLAIN: dict[str, dict[str, Any]] = {
    "equiigd": {"reg": (6, 12, 24), "hidden": 8, "flow_reg": 4, "flow_triv": 32, "value_reg": 12},
    "equigiga": {"reg": (6, 12, 24), "hidden": 12, "side_hidden": 7},
}
"""Sizes that give the `plain` networks as many parameters as the `c4` ones have (within 2 %)."""


def plain_counterpart(name: str) -> dict[str, Any]:
    """Config values of the network of that name without the symmetry, with equally many parameters."""
    return {"side": "mixed", "symmetry": "plain"} | PLAIN[name]
