"""What the networks say at lattice points of an encoded scene: their own maths, folded to be fast on a processor."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import torch
from torch import Tensor, nn

from evg_app.geometry import GRID_SIZE
from evg_app.grasping.fast import trunks
from evg_app.grasping.fast.attention import Grip, Look
from evg_app.grasping.fast.field import PIXEL_W, Field
from evg_app.grasping.fast.graph import Native
from evg_app.nets.equigiga import EquiGIGA
from evg_app.nets.equiigd import EquiIGD
from evg_app.nets.heads import Head
from evg_app.nets.rotation import from_rows


@dataclass(frozen=True)
class Place:
    """Points of a lattice in an encoded scene.

    Attributes:
        field: the scene.
        index: flat indices into the lattice (side, side, side). Shape (N,).
        side: 40 for voxel centres, 20 for the centres of their 2x2x2 blocks.
    """

    field: Field
    index: Tensor
    side: int = GRID_SIZE

    def features(self) -> Tensor:
        """Shape (N, 2 C)."""
        return self.field.at_lattice(self.index, self.side)

    def pixels(self) -> Tensor:
        """Where the points are. Shape (N, 4)."""
        side, step = self.side, GRID_SIZE // self.side
        jk = self.index % (side * side)
        ijk = [self.index // (side * side), jk // side, jk % side]
        pixels = torch.stack([*ijk, ijk[0]], 1).to(torch.float32).mul_(step).add_(0.5 * (step - 1))
        pixels[:, 3] = PIXEL_W
        return pixels


class Heads(Protocol):
    """Answers at points."""

    @property
    def regresses(self) -> bool:
        """Whether one candidate rotation needs no noise."""

    def graspness(self, place: Place) -> Tensor:
        """Logit that a grasp centred there succeeds for some rotation. (N,)."""

    def width(self, place: Place) -> Tensor:
        """Opening after a grasp there, fraction of 0.3 m. (N,)."""

    def rotations(self, place: Place, noise: Tensor, steps: int) -> tuple[Tensor, Tensor]:
        """Candidate rotations (S, N, 3, 3) from noise (draws, N, 6), and scores in [0, 1] for each (S, N, 1 or 2).

        The first score is of success without touching anything on the approach, the last allows that.
        """


class EquiIGDHeads:
    """Of EquiIGD: flow samples and the regressed rotation, scored by the classifier."""

    def __init__(self, net: EquiIGD) -> None:
        self._graspness_look, self._rotation_look = Look(net.graspness_attention), Look(net.rotation_attention)
        self._grip = Grip(net.score_attention)
        self._graspness = trunks.head(net.graspness_head, self._graspness_look.attended)
        self._width = trunks.head(net.width_head)
        self._score = trunks.head(net.score_head, self._grip.attended)
        self._regress: Native | None = None
        if isinstance(net.rotation_head, Head):
            self._regress = trunks.head(net.rotation_head, self._rotation_look.attended, to_rows=True)
        self._net = net
        self._flow = lru_cache(maxsize=4)(self._make_flow)

    @property
    def regresses(self) -> bool:
        """See `Heads`."""
        return self._regress is not None

    def _make_flow(self, draws: int, steps: int) -> Native:
        return trunks.flow(self._net.flow, self._rotation_look.attended, draws, steps)

    def graspness(self, place: Place) -> Tensor:
        """See `Heads`."""
        return self._graspness(self._graspness_look(place.field, place.features(), place.pixels()))[0][:, 0]

    def width(self, place: Place) -> Tensor:
        """See `Heads`."""
        return self._width(place.features())[0][:, 0]

    def rotations(self, place: Place, noise: Tensor, steps: int) -> tuple[Tensor, Tensor]:
        """See `Heads`."""
        c, pixels = place.features(), place.pixels()
        seen = self._rotation_look(place.field, c, pixels)
        rows = [self._flow(len(noise), steps)(seen, noise.reshape(-1, 6))[0]] if len(noise) else []
        if self._regress is not None:
            rows.append(self._regress(seen)[0])
        rotation = from_rows(torch.cat(rows))
        draws = len(rotation) // len(c)
        read = self._grip(place.field, c.repeat(draws, 1), pixels.repeat(draws, 1), rotation)
        return rotation.view(draws, -1, 3, 3), self._score(read)[0].sigmoid_().view(draws, len(c), -1)


class EquiGIGAHeads:
    """Of EquiGIGA: one regressed rotation, without a score of its own (ones)."""

    regresses = True

    def __init__(self, net: EquiGIGA) -> None:
        self._graspness, self._width = trunks.head(net.graspness_head), trunks.head(net.width_head)
        self._rotation = trunks.head(net.rotation_head, to_rows=True)

    def graspness(self, place: Place) -> Tensor:
        """See `Heads`."""
        return self._graspness(place.features())[0][:, 0]

    def width(self, place: Place) -> Tensor:
        """See `Heads`."""
        return self._width(place.features())[0][:, 0]

    def rotations(self, place: Place, noise: Tensor, steps: int) -> tuple[Tensor, Tensor]:
        """See `Heads`."""
        rotation = from_rows(self._rotation(place.features())[0])[None]
        return rotation, torch.ones((*rotation.shape[:2], 1))


def heads_of(net: nn.Module) -> Heads:
    """The fast heads of a network.

    Raises:
        TypeError: it is neither EquiIGD nor EquiGIGA.
    """
    if isinstance(net, EquiIGD):
        return EquiIGDHeads(net)
    if isinstance(net, EquiGIGA):
        return EquiGIGAHeads(net)
    raise TypeError(f"no fast heads for {type(net).__name__}")
