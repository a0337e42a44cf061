"""What EquiIGD and EquiGIGA say at lattice points of an encoded scene: their own maths, folded to be fast.

A `Place` names the points; all functions take the calling thread's buffers.
"""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor, nn

from evg_app.geometry import GRID_SIZE
from evg_app.grasping.fast.attention import Grip, Look
from evg_app.grasping.fast.field import PIXEL_W, Field, Reader
from evg_app.grasping.fast.layers import Affine, Buffers, FoldedHead
from evg_app.grasping.fast.sampler import FlowSampler
from evg_app.nets.equigiga import EquiGIGA
from evg_app.nets.equiigd import EquiIGD
from evg_app.nets.heads import Head
from evg_app.nets.rotation import from_rows, vectors_to_rows


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

    def graspness(self, place: Place, buffers: Buffers) -> Tensor:
        """Logit that a grasp centred there succeeds for some rotation. (N,)."""

    def width(self, place: Place, buffers: Buffers) -> Tensor:
        """Opening after a grasp there, fraction of 0.3 m. (N,)."""

    def rotations(self, place: Place, noise: Tensor, steps: int, buffers: Buffers) -> tuple[Tensor, Tensor]:
        """Candidate rotations (S, N, 3, 3) from noise (draws, N, 6), and scores in [0, 1] for each (S, N, 1 or 2).

        The first score is of success without touching anything on the approach, the last allows that.
        """


class EquiIGDHeads:
    """Of EquiIGD: flow samples and the regressed rotation, scored by the classifier."""

    def __init__(self, net: EquiIGD, device: torch.device) -> None:
        several, single = Reader(net.config.offsets, device), Reader(1, device)
        self._graspness_look = Look(net.graspness_attention, several, device)
        self._rotation_look = Look(net.rotation_attention, several, device)
        self._grip = Grip(net.score_attention, single, device)
        self._graspness = FoldedHead(net.graspness_head, self._graspness_look.attended, "head", device)
        self._width = FoldedHead(net.width_head, None, "head", device)
        self._flow = FlowSampler(net.flow, self._rotation_look.attended, device)
        self._score = FoldedHead(net.score_head, self._grip.attended, "head", device)
        self._regress = _vector_head(net.rotation_head, self._rotation_look.attended, device)

    def graspness(self, place: Place, buffers: Buffers) -> Tensor:
        """See `Heads`."""
        seen = self._graspness_look(place.field, place.features(), place.pixels(), buffers)
        return self._graspness(seen, buffers)[:, 0]

    def width(self, place: Place, buffers: Buffers) -> Tensor:
        """See `Heads`."""
        return self._width(place.features(), buffers)[:, 0]

    def rotations(self, place: Place, noise: Tensor, steps: int, buffers: Buffers) -> tuple[Tensor, Tensor]:
        """See `Heads`."""
        c, pixels = place.features(), place.pixels()
        seen = self._rotation_look(place.field, c, pixels, buffers)
        rows = [self._flow.sample(seen, noise, steps, buffers)] if len(noise) else []
        if self._regress is not None:
            rows.append(vectors_to_rows(self._regress(seen, buffers))[None])
        rotation = from_rows(torch.cat(rows))
        draws = len(rotation)
        read = self._grip(place.field, c.repeat(draws, 1), pixels.repeat(draws, 1), rotation.flatten(0, 1), buffers)
        return rotation, self._score(read, buffers).sigmoid_().view(draws, len(c), -1)


class EquiGIGAHeads:
    """Of EquiGIGA: one regressed rotation, without a score of its own (ones)."""

    def __init__(self, net: EquiGIGA, device: torch.device) -> None:
        self._graspness = FoldedHead(net.graspness_head, None, "head", device)
        self._rotation = FoldedHead(net.rotation_head, None, "head", device)
        self._width = FoldedHead(net.width_head, None, "side", device)

    def graspness(self, place: Place, buffers: Buffers) -> Tensor:
        """See `Heads`."""
        return self._graspness(place.features(), buffers)[:, 0]

    def width(self, place: Place, buffers: Buffers) -> Tensor:
        """See `Heads`."""
        return self._width(place.features(), buffers)[:, 0]

    def rotations(self, place: Place, noise: Tensor, steps: int, buffers: Buffers) -> tuple[Tensor, Tensor]:
        """See `Heads`."""
        rotation = from_rows(vectors_to_rows(self._rotation(place.features(), buffers)))[None]
        return rotation, torch.ones((*rotation.shape[:2], 1), device=rotation.device)


def _vector_head(head: nn.Module | None, before: Affine, device: torch.device) -> FoldedHead | None:
    """The head of the regressed rotation, where the network has one."""
    return FoldedHead(head, before, "head", device) if isinstance(head, Head) else None


def heads_of(net: nn.Module, device: torch.device) -> Heads:
    """The fast heads of a network.

    Raises:
        TypeError: it is neither EquiIGD nor EquiGIGA.
    """
    if isinstance(net, EquiIGD):
        return EquiIGDHeads(net, device)
    if isinstance(net, EquiGIGA):
        return EquiGIGAHeads(net, device)
    raise TypeError(f"no fast heads for {type(net).__name__}")
