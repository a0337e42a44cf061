"""Networks by name, as the cards of weights files name them."""

from typing import Any

from torch import nn

from evg_app.errors import UnknownName
from evg_app.nets.config import EquiGIGAConfig, EquiIGDConfig
from evg_app.nets.equigiga import EquiGIGA
from evg_app.nets.equiigd import EquiIGD

NAMES = ("equigiga", "equiigd")
"""Names that `build` knows."""


def build(name: str, config: dict[str, Any] | None = None) -> nn.Module:
    """A network with random weights, from its name and its config as a dict (`to_dict`).

    Raises:
        UnknownName: no network has this name.
        ValueError: the config has unknown keys.
    """
    if name == "equigiga":
        return EquiGIGA(EquiGIGAConfig.from_dict(config or {}))
    if name == "equiigd":
        return EquiIGD(EquiIGDConfig.from_dict(config or {}))
    raise UnknownName("network", name, list(NAMES))
