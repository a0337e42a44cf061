"""What another model would have done on the depth of a recorded attempt."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from evg_app.geometry import Array
from evg_app.trials.recorded import RecordedAttempt
from evg_app.trials.replay import Pipeline


@dataclass(frozen=True)
class WhatIf:
    """The other model beside what was done.

    Attributes:
        attempt_id, outcome: what was done and how it ended.
        candidates: grasps that the other model proposes.
        verdicts: how they were judged.
        score: of its chosen grasp, None without one.
        distance_m, angle_rad: from the executed grasp to its chosen one (antipodal twins are the same grasp);
            None when either has none.
    """

    attempt_id: str
    outcome: str
    candidates: int
    verdicts: dict[str, int]
    score: float | None
    distance_m: float | None
    angle_rad: float | None

    @property
    def would_pick(self) -> bool:
        """Whether the other model has a feasible grasp."""
        return self.score is not None

    def line(self) -> str:
        """For a terminal."""
        did = f"{self.attempt_id} ({self.outcome}): {self.candidates} candidates"
        if self.score is None:
            return f"{did}, none feasible"
        if self.distance_m is None or self.angle_rad is None:
            return f"{did}, would pick with score {self.score:.2f}"
        away = f"{1e3 * self.distance_m:.0f} mm and {np.degrees(self.angle_rad):.0f} deg from the executed grasp"
        return f"{did}, would pick with score {self.score:.2f}, {away}"

    def facts(self) -> dict[str, Any]:
        """As JSON."""
        return dict(self.__dict__)


def what_if(attempt: RecordedAttempt, pipeline: Pipeline) -> WhatIf:
    """Recompute an attempt with another model."""
    gathered = pipeline.recompute(attempt)
    judged, score, gap = gathered.judged, None, None
    if judged is not None and judged.chosen is not None and judged.T_base_grasp is not None:
        score = float(gathered.grasps.score[judged.chosen])
        if "T_base_grasp" in attempt.stored:
            gap = apart(attempt.stored["T_base_grasp"], judged.T_base_grasp)
    return WhatIf(
        attempt.attempt_id,
        attempt.outcome,
        len(gathered.grasps),
        dict(Counter(str(v.value) for v in judged.verdicts)) if judged is not None else {},
        score,
        None if gap is None else gap[0],
        None if gap is None else gap[1],
    )


def apart(a: Array, b: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two grasp poses (4, 4); turning by pi about the approach changes nothing."""
    twin = b[:3, :3] @ np.diag([-1.0, -1.0, 1.0])
    cosines = [(np.trace(a[:3, :3].T @ R) - 1.0) / 2.0 for R in (b[:3, :3], twin)]
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3])), float(np.arccos(np.clip(max(cosines), -1.0, 1.0)))
