"""What the networks say at lattice points of an encoded scene: their own maths, folded to be fast on a processor.

An answer is a few native calls, graphs and what a `Reader` reads between them: what Python does between calls would
keep the other threads waiting.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

from torch import Tensor, nn

from evg_app.geometry import GRID_SIZE
from evg_app.grasping.fast import trunks
from evg_app.grasping.fast.attention import Grip, Look, Results
from evg_app.grasping.fast.field import Field, lattice_features, lattice_inputs, lattice_of
from evg_app.grasping.fast.graph import Graph, Native, Shape
from evg_app.grasping.fast.orthonormal import from_rows
from evg_app.nets.attention import DeformableAttention
from evg_app.nets.equigiga import EquiGIGA
from evg_app.nets.equiigd import EquiIGD
from evg_app.nets.fibres import ORDER
from evg_app.nets.heads import Head


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

    def features(self) -> tuple[Tensor, Tensor]:
        """Inputs of `lattice_features`."""
        return self.field.lattice(self.side), lattice_of(self.side).rows.index_select(0, self.index)

    def pixels(self) -> Tensor:
        """Where the points are. Shape (N, 4)."""
        return lattice_of(self.side).pixels.index_select(0, self.index)


class Heads(Protocol):
    """Answers at points."""

    @property
    def regresses(self) -> bool:
        """Whether one candidate rotation needs no noise."""

    def graspness(self, place: Place) -> Tensor:
        """Logit that a grasp centred there succeeds for some rotation. (N,)."""

    def grasps(self, place: Place, noise: Tensor, steps: int) -> tuple[Tensor, Tensor, Tensor]:
        """Candidate rotations (S, N, 3, 3) from noise (draws, N, 6), scores in [0, 1] for each (S, N, 1 or 2), and
        openings after a grasp there, fraction of 0.3 m (N,).

        The first score is of success without touching anything on the approach, the last allows that.
        """


class EquiIGDHeads:
    """Of EquiIGD: flow samples and the regressed rotation, scored by the classifier."""

    def __init__(self, net: EquiIGD) -> None:
        self._net = net
        self.regresses = net.rotation_head is not None
        looks = net.graspness_attention, net.rotation_attention
        self._look, self._rotation_look = (Look(a) for a in looks if isinstance(a, DeformableAttention))
        self._grip = Grip(net.score_attention)
        self._channels = ORDER * net.config.reg[0]
        self._ask, self._ask_rotation = (
            self._asking(self._look, None),
            self._asking(self._rotation_look, net.width_head),
        )
        g, inputs = Graph(), self._read_inputs()
        logit = trunks.head(g, g.add("Concat", "c", "read", axis=1), net.graspness_head, self._look.attended)
        self._graspness = Native(g.model(inputs, {"logit": (logit, ["n", 1])}))
        self._rotate, self._score = lru_cache(maxsize=8)(self._rotating), lru_cache(maxsize=8)(self._scoring)

    def _read_inputs(self) -> dict[str, Shape]:
        """A point's features, and what was read for it."""
        return {"c": ["n", 2 * self._channels], "read": ["n", 2 * self._channels]}

    def _asking(self, look: Look, width: nn.Module | None) -> Native:
        """From a place and pixels to features c, what the look's reader wants, and maybe the width."""
        g = Graph()
        c = lattice_features(g, self._channels)
        results: Results = {"c": (c, ["n", 2 * self._channels])}
        results |= look.ask(g, c, "pixels")
        if isinstance(width, Head):
            results["width"] = (trunks.head(g, c, width), ["n", 1])
        return Native(g.model(lattice_inputs(self._channels) | {"pixels": ["n", 4]}, results))

    def _rotating(self, draws: int, steps: int) -> Native:
        """From features, what was read, pixels and noise (draws * N, 6) to rotations and what the grip wants."""
        g, look = Graph(), self._rotation_look
        seen = g.add("Concat", "c", "read", axis=1)
        rows = [trunks.flow(g, seen, "noise", self._net.flow, look.attended, draws, steps)] if draws else []
        if isinstance(self._net.rotation_head, Head):
            rows.append(trunks.head(g, seen, self._net.rotation_head, look.attended, to_rows=True))
        rotation = from_rows(g, g.add("Concat", *rows, axis=0))
        results: Results = {"rotation": (rotation, ["m", 9])}
        results |= self._grip.ask(g, rotation, "pixels", draws + self.regresses)
        inputs = self._read_inputs() | {"pixels": ["n", 4]} | ({"noise": ["k", 6]} if draws else {})
        return Native(g.model(inputs, results))

    def _scoring(self, candidates: int) -> Native:
        """From features and what was read at the control points to the scores of all candidates (m, 1 or 2)."""
        g = Graph()
        seen = self._grip.mean(g, "c", "read", candidates)
        score = g.add("Sigmoid", trunks.head(g, seen, self._net.score_head, self._grip.attended))
        inputs = self._read_inputs() | {"read": ["p", 2 * self._channels]}
        return Native(g.model(inputs, {"score": (score, ["m", "scores"])}))

    def graspness(self, place: Place) -> Tensor:
        """See `Heads`."""
        c, index, factor = self._ask(*place.features(), place.pixels())
        return self._graspness(c, self._look.reader.read(place.field, index, factor))[0][:, 0]

    def grasps(self, place: Place, noise: Tensor, steps: int) -> tuple[Tensor, Tensor, Tensor]:
        """See `Heads`."""
        pixels = place.pixels()
        c, index, factor, width = self._ask_rotation(*place.features(), pixels)
        read = self._rotation_look.reader.read(place.field, index, factor)
        start = [noise.reshape(-1, 6)] if len(noise) else []
        rotation, index, factor = self._rotate(len(noise), steps)(c, read, pixels, *start)
        candidates = len(rotation) // len(c)
        score = self._score(candidates)(c, self._grip.reader.read(place.field, index, factor))[0]
        return rotation.view(candidates, -1, 3, 3), score.view(candidates, len(c), -1), width[:, 0]


class EquiGIGAHeads:
    """Of EquiGIGA: one regressed rotation, without a score of its own (ones)."""

    regresses = True

    def __init__(self, net: EquiGIGA) -> None:
        assert isinstance(net.graspness_head, Head) and isinstance(net.rotation_head, Head)
        assert isinstance(net.width_head, Head)
        channels = ORDER * net.config.reg[0]
        g = Graph()
        logit = trunks.head(g, lattice_features(g, channels), net.graspness_head)
        self._graspness = Native(g.model(lattice_inputs(channels), {"logit": (logit, ["n", 1])}))
        g = Graph()
        c = lattice_features(g, channels)
        rotation = from_rows(g, trunks.head(g, c, net.rotation_head, to_rows=True))
        results: Results = {"rotation": (rotation, ["n", 9]), "width": (trunks.head(g, c, net.width_head), ["n", 1])}
        self._grasps = Native(g.model(lattice_inputs(channels), results))

    def graspness(self, place: Place) -> Tensor:
        """See `Heads`."""
        return self._graspness(*place.features())[0][:, 0]

    def grasps(self, place: Place, noise: Tensor, steps: int) -> tuple[Tensor, Tensor, Tensor]:
        """See `Heads`."""
        rotation, width = self._grasps(*place.features())
        return rotation.view(1, -1, 3, 3), rotation.new_ones(1, len(rotation), 1), width[:, 0]


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
