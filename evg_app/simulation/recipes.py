"""What a scene is asked to hold (spec §4.2)."""

from dataclasses import dataclass

import numpy as np

from evg_app.errors import BadInput

KINDS = ("packed", "pile", "adversarial")
"""Scene kinds: upright and apart, thrown together, and thrown together from awkward shapes."""


@dataclass(frozen=True)
class Poisson:
    """A random count: `minimum` plus a Poisson number of mean `mean` (spec §4.2: 1 + Poisson(4))."""

    mean: float = 4.0
    minimum: int = 1


@dataclass(frozen=True)
class SceneRecipe:
    """What to build.

    Attributes:
        kind: "packed", "pile" or "adversarial".
        count: objects asked for; packed scenes may hold fewer.
        scale_range: uniform range of each object's scale; None is spec §4.2's for the kind.
    """

    kind: str
    count: int | Poisson = 5
    scale_range: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise BadInput(f"unknown scene kind '{self.kind}'; available: {', '.join(KINDS)}.")

    def draw_count(self, rng: np.random.Generator) -> int:
        """How many objects this scene asks for."""
        if isinstance(self.count, int):
            return self.count
        return self.count.minimum + int(rng.poisson(self.count.mean))

    def draw_scale(self, rng: np.random.Generator) -> float:
        """Scale of one object."""
        low, high = self.scale_range or ((0.7, 0.9) if self.kind == "packed" else (0.8, 1.0))
        return float(rng.uniform(low, high))
