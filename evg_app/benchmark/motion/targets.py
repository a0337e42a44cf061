"""Grasps to execute, from geometry alone: the data engine's labels, so that no network's weights matter."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import Array
from evg_app.learning.generate import solids_of
from evg_app.learning.labels import Kind, sample_and_label
from evg_app.learning.solids import SceneSolids
from evg_app.learning.surface import half_spaces, sample_surface
from evg_app.simulation.state import SceneState
from evg_app.types import Grasps


@dataclass(frozen=True)
class Targets:
    """Grasps that hold, and whose approach is free, by the labels; in random order.

    Attributes:
        T_task_grasp: shape (N, 4, 4).
        width: opening when it holds [m]. Shape (N,).
        owner: index of the object that is grasped. Shape (N,).
    """

    T_task_grasp: Array
    width: Array
    owner: NDArray[np.int64]

    def __len__(self) -> int:
        """How many."""
        return len(self.width)

    def of(self, owner: int, limit: int) -> Grasps:
        """At most `limit` grasps of one object, as a planner would propose them."""
        return self.take(np.flatnonzero(self.owner == owner)[:limit])

    def take(self, index: NDArray[np.int64]) -> Grasps:
        """Some of them as ranked grasps."""
        score = np.linspace(1.0, 0.5, max(len(index), 1))[: len(index)]
        return Grasps(self.T_task_grasp[index], self.width[index], score)

    def spread(self, limit: int) -> NDArray[np.int64]:
        """Indices of at most `limit` grasps, the objects taking turns."""
        turn = np.zeros(len(self), dtype=np.int64)
        for one in np.unique(self.owner):
            mine = self.owner == one
            turn[mine] = np.arange(mine.sum())
        return np.asarray(np.argsort(turn, kind="stable")[:limit])


def targets_of(state: SceneState, candidates: int, rng: np.random.Generator) -> Targets:
    """Label about `candidates` grasps of a scene and keep the positives."""
    solids = solids_of(state)
    surface = sample_surface(solids, half_spaces(solids), candidates, rng)
    labelled = sample_and_label(SceneSolids(solids), surface, candidates, rng)
    good = rng.permutation(np.flatnonzero((labelled.kind == Kind.POSITIVE) & (labelled.owner >= 0)))
    return Targets(labelled.T_task_grasp[good], labelled.width[good], labelled.owner[good])
