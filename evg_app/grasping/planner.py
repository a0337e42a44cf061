"""The networks' planner: coarse to fine, and the network alone ranks.

1. Encode the grid once. 2. Ask graspness near seen surface, coarse to fine (`search`); smooth. 3. For the best voxels:
rotations (regressed, and for the best of them flow samples), classified; the best one stays.
4. q = sqrt(graspness * score), width and threshold, near duplicates go, sort.

`dense=True` asks all candidate voxels instead (the paper's way, the reference); everything else is the same.
"""

import copy
import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from evg_app.errors import BadInput, WeightsError
from evg_app.geometry import GRID_SIZE, WORKSPACE_SIZE, Array, make
from evg_app.grasping import lattice, selection
from evg_app.grasping.fast.eager import EagerEncoder, EagerHeads
from evg_app.grasping.fast.encoder import Encoder, FastEncoder
from evg_app.grasping.fast.field import Field
from evg_app.grasping.fast.heads import Heads, Place, heads_of
from evg_app.grasping.fast.workers import Workers, pieces
from evg_app.grasping.protocol import Grid, grid_values
from evg_app.grasping.search import coarse_to_fine
from evg_app.grasping.weights import load_weights
from evg_app.nets.equigiga import EquiGIGA
from evg_app.nets.equiigd import EquiIGD
from evg_app.nets.triplane import JointTriUNet
from evg_app.types import Grasps

_log = logging.getLogger(__name__)
Lap = Callable[[str], None]
"""Hears what has just been done."""
MOST_THREADS = 4
"""More threads than this do not make a plan faster."""


@dataclass(frozen=True)
class PlannerConfig:
    """How a plan is searched.

    Attributes:
        refined, blocks: blocks that are asked after the seeds, and whose voxels are asked (`search.coarse_to_fine`).
        points: best voxels K that get rotations.
        per_block: at most so many of one block of 2x2x2 voxels, so that K voxels cover all objects.
        sampled: the best of them get flow samples beside the regressed rotation (all, where the network has none).
        samples: flow samples per voxel.
        steps: Euler steps of the flow (2-5 were as good as 10, learning.md's measurement).
        sigma: smoothing of graspness [voxels].
        threshold: least score of a grasp (LOW_TH of spec §5).
        nms_radius: near duplicates within this distance [m] (not a distance of two voxel centres: no ties) ...
        nms_angle: ... and this angle [rad] of a better grasp go.
        max_grasps: best grasps that are compared with each other.
        dense: ask all 64,000 voxels, rotations and flow samples wherever graspness exceeds `dense_graspness`.
        dense_graspness: spec §5.1's low_th.
        allow_contact: rank by the score of grasps whose approach may touch something, where the network has one.
        points_at_once, grasps_at_once: points asked for graspness, and for rotations, per piece of work: so many
            that what is computed for them fits the second-level cache.
    """

    refined: int = 256
    blocks: int = 48
    points: int = 128
    per_block: int = 3
    sampled: int = 48
    samples: int = 2
    steps: int = 5
    sigma: float = 1.0
    threshold: float = 0.2
    nms_radius: float = 0.016
    nms_angle: float = 0.5236
    max_grasps: int = 1024
    dense: bool = False
    dense_graspness: float = 0.05
    allow_contact: bool = False
    points_at_once: int = 1024
    grasps_at_once: int = 40


class GraspPlanner:
    """Plans with EquiIGD or EquiGIGA. See `load`."""

    def __init__(
        self,
        net: nn.Module,
        *,
        name: str,
        weights_sha256: str = "",
        config: PlannerConfig | None = None,
        device: str = "cpu",
    ) -> None:
        if not isinstance(net, EquiIGD | EquiGIGA):
            raise BadInput(f"no planner for a network of type {type(net).__name__}; use EquiIGD or EquiGIGA")
        self._device = torch_device(device)
        self._net = net.eval().to(self._device)
        self._name, self._sha = name, weights_sha256
        self.config = config or PlannerConfig()
        on_cpu = self._device.type == "cpu"
        threads = min(torch.get_num_threads(), MOST_THREADS) if on_cpu else 1
        self._workers = Workers(threads)
        fast = on_cpu and not net.config.reduced
        self._encoder: Encoder = FastEncoder(net.backbone, threads) if fast else EagerEncoder(net, self._device)
        self._heads: Heads = heads_of(net) if fast else EagerHeads(net)

    @classmethod
    def load(
        cls,
        model: str = "equiigd",
        weights: str | Path | None = None,
        device: str = "cpu",
        config: PlannerConfig | None = None,
    ) -> Self:
        """A planner with trained weights.

        Args:
            model: "equiigd" or "equigiga".
            weights: a shipped name or a `.safetensors` path; None for the shipped weights of the model's name.
            device: "cpu", or "cuda" where there is one (else it says so and takes the cpu). On the cpu it uses as
                many threads as torch is set to, at most `MOST_THREADS`.
            config: how to search.

        Raises:
            WeightsError: weights missing, corrupt, or of another model.
            BadInput: torch does not have the device.
        """
        net, card = load_weights(weights if weights is not None else model)
        if card.architecture != model:
            raise WeightsError(
                f"weights '{card.name}' are for the model '{card.architecture}', not '{model}'; "
                f"use --model {card.architecture} or other --weights"
            )
        return cls(net, name=model, weights_sha256=card.sha256, config=config, device=device)

    @property
    def name(self) -> str:
        """The model's name."""
        return self._name

    @property
    def weights_sha256(self) -> str:
        """Hash of the weights file, empty for a bare network."""
        return self._sha

    @property
    def backbone(self) -> JointTriUNet:
        """The network's encoder, on the planner's device."""
        backbone = self._net.backbone
        assert isinstance(backbone, JointTriUNet)
        return backbone

    def plan(self, grid: Grid, seed: int = 0, lap: Lap = lambda stage: None) -> Grasps:
        """Ranked grasps in the task frame, best first; the same for the same grid and seed.

        Args:
            grid: a TsdfGrid, or its bare values (40, 40, 40) in the convention of spec §1.
            seed: of the flow's noise.
            lap: hears the name of each stage when it is over: mask, encode, locate, orient, select.

        Raises:
            BadInput: the grid has another shape or values outside [0, 1].
        """
        values = grid_values(grid)
        mask = selection.candidate_mask(values)
        lap("mask")
        if not mask.any():
            return Grasps.empty()
        with torch.inference_mode():
            field = self.encode(values)
            lap("encode")
            index, graspness = self.locate(field, mask)
            lap("locate")
            if len(index) == 0:
                return Grasps.empty()
            rotation, score, width = self.orient(field, index, seed)
            lap("orient")
        grasps = self.assemble(index, rotation, np.sqrt(graspness * score), width)
        lap("select")
        return grasps

    def plan_dense(self, grid: Grid, seed: int = 0, lap: Lap = lambda stage: None) -> Grasps:
        """The reference: `plan` with the dense search of the paper, through the same layers and threads."""
        dense = copy.copy(self)
        dense.config = replace(self.config, dense=True)
        return dense.plan(grid, seed, lap)

    def encode(self, values: NDArray[np.float32]) -> Field:
        """Features of one grid (40, 40, 40)."""
        return Field(self._encoder(values))

    def locate(self, field: Field, mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], Array]:
        """Where to grasp: flat voxel indices (K,) with their smoothed graspness in [0, 1] (K,), best first."""
        if self.config.dense:
            volume = self._graspness(field, np.arange(GRID_SIZE**3), GRID_SIZE).reshape((GRID_SIZE,) * 3)
            fine = np.flatnonzero(mask)
        else:
            ask = partial(self._graspness, field)
            volume, fine = coarse_to_fine(mask, ask, self.config.refined, self.config.blocks)
        smoothed = selection.smooth(volume, mask, self.config.sigma).ravel()[fine]
        if self.config.dense:
            keep = np.flatnonzero(smoothed > self.config.dense_graspness)
            keep = keep[selection.best(smoothed[keep], len(keep))]
        else:
            keep = selection.spread(smoothed, lattice.block_of(fine), self.config.per_block, self.config.points)
            keep = keep[smoothed[keep] >= self.config.threshold**2]  # q <= sqrt(graspness)
        return fine[keep], smoothed[keep].astype(np.float64)

    def orient(self, field: Field, index: NDArray[np.intp], seed: int) -> tuple[Array, Array, Array]:
        """How to grasp at voxels (K,): rotation (K, 3, 3), its score in [0, 1] (K,), opening [m] (K,)."""
        everywhere = self.config.dense or not self._heads.regresses
        sampled = len(index) if everywhere else min(self.config.sampled, len(index))
        noise = self._tensor(lattice.rotation_noise(index[:sampled], self.config.samples, seed))
        voxels = self._tensor(index)

        def ask(part: slice) -> tuple[Tensor, Tensor, Tensor]:
            """Best candidate of some of the voxels."""
            place = Place(field, voxels[part])
            draws = noise[:, part] if part.start < sampled else noise[:0]
            candidates, scores, width = self._heads.grasps(place, draws, self.config.steps)
            score, which = scores[..., -1 if self.config.allow_contact else 0].max(0)
            rotation = candidates[which, torch.arange(len(which), device=self._device)]
            return rotation, score, width

        rest = [slice(p.start + sampled, p.stop + sampled) for p in self._pieces(len(index) - sampled)]
        parts = self._workers.map(ask, [*self._pieces(sampled), *rest])
        answers = [torch.cat(part).cpu().numpy().astype(np.float64) for part in zip(*parts, strict=True)]
        return answers[0], answers[1], answers[2] * WORKSPACE_SIZE

    def assemble(self, index: NDArray[np.intp], rotation: Array, score: Array, width: Array) -> Grasps:
        """The grasps worth keeping of those at voxels (K,), best first."""
        keep = np.flatnonzero((score >= self.config.threshold) & selection.width_mask(width))
        keep = keep[selection.best(score[keep], self.config.max_grasps)]
        T = make(_orthonormal(rotation[keep]), lattice.voxel_positions(index[keep]))
        order = selection.suppress(T, score[keep], self.config.nms_radius, self.config.nms_angle)
        return Grasps(T[order], width[keep][order], score[keep][order])

    def _graspness(self, field: Field, index: NDArray[np.intp], side: int) -> NDArray[np.float32]:
        """Graspness in [0, 1] at lattice points (see `Place`). Shape (N,)."""
        if len(index) == 0:
            return np.zeros(0, dtype=np.float32)
        points = self._tensor(index)

        def ask(part: slice) -> Tensor:
            """Logits of some of the points."""
            return self._heads.graspness(Place(field, points[part], side))

        parts = self._workers.map(ask, pieces(len(index), self.config.points_at_once))
        answer: NDArray[np.float32] = torch.cat(parts).sigmoid().cpu().numpy()
        return answer

    def _pieces(self, grasps: int) -> list[slice]:
        """Pieces of work of so many grasps."""
        return pieces(grasps, self.config.grasps_at_once)

    def _tensor(self, array: NDArray[np.float32] | NDArray[np.intp]) -> Tensor:
        """The array on the planner's device."""
        return torch.from_numpy(array).to(self._device)


def _orthonormal(rotation: Array) -> Array:
    """Nearest rotations in float64: the networks' float32 ones are orthonormal to 1e-6 only. Shape (N, 3, 3)."""
    error = rotation.transpose(0, 2, 1) @ rotation - np.eye(3)
    nearest: Array = rotation - 0.5 * rotation @ error  # Newton's step towards the polar factor: 1e-6 becomes 1e-12
    far = np.abs(error).max(axis=(1, 2)) > 1e-4
    if far.any():  # the network gave two parallel rows
        u, _, vt = np.linalg.svd(rotation[far])
        nearest[far] = u @ vt
    return nearest


def torch_device(device: str) -> torch.device:
    """The torch device of that name; the cpu, with a warning, where "cuda" is wanted and there is none.

    Raises:
        BadInput: there is no such device.
    """
    if device.startswith("cuda") and not torch.cuda.is_available():
        _log.warning("no CUDA device can be used; planning on the cpu. See evg-app doctor, or install with --cuda")
        device = "cpu"
    try:
        chosen = torch.device(device)
        torch.zeros(1, device=chosen)
    except (RuntimeError, AssertionError) as error:
        raise BadInput(f"torch cannot use the device '{device}'; use cpu, or install with --cuda") from error
    return chosen
