"""Whether coarse to fine finds what asking everything finds: the best grasps of both, scene by scene."""

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from evg_app.benchmark.journal import Journal
from evg_app.benchmark.latency.frames import CAMERA, DEPTH_SCALE, VERSION, DepthFrame, load_frame
from evg_app.geometry import VOXEL_SIZE
from evg_app.grasping.planner import GraspPlanner
from evg_app.perception.tsdf import fuse_depth
from evg_app.types import Grasps

POSITION = 1.001 * VOXEL_SIZE
"""Best grasps this close [m] ..."""
ANGLE = 15.0
"""... whose approaches differ by no more than this [deg] are the same."""
SCORE = 0.02
"""Different best grasps are as good as each other when the scores differ by no more than this."""


@dataclass(frozen=True)
class Pair:
    """Fast and dense on one frame.

    Attributes:
        frame: its number.
        same_place: the best grasps are the same, or neither found any.
        score_fast, score_dense: of the best grasps, 0 without one.
    """

    frame: int
    same_place: bool
    score_fast: float
    score_dense: float

    @property
    def agree(self) -> bool:
        """The same grasp, or one as good."""
        return self.same_place or abs(self.score_fast - self.score_dense) <= SCORE

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The opposite of `to_dict`."""
        return cls(**values)


def pair(planner: GraspPlanner, number: int, frame: DepthFrame) -> Pair:
    """Plan one frame both ways."""
    grid = fuse_depth(frame.depth, CAMERA, frame.T_cam_task, DEPTH_SCALE)
    fast, dense = planner.plan(grid), planner.plan_dense(grid)
    return Pair(number, same_best(fast, dense), *(float(g.score[0]) if len(g) else 0.0 for g in (fast, dense)))


def same_best(fast: Grasps, dense: Grasps) -> bool:
    """Whether the best grasps lie within a voxel and 15 degrees of approach, or there is none in both."""
    if len(fast) == 0 or len(dense) == 0:
        return len(fast) == len(dense)
    a, b = fast.T_task_grasp[0], dense.T_task_grasp[0]
    near = bool(np.linalg.norm(a[:3, 3] - b[:3, 3]) <= POSITION)
    return near and bool(a[:3, 2] @ b[:3, 2] >= np.cos(np.deg2rad(ANGLE)))


def compare(
    frames: int, weights: str | None, json_path: Path | None, progress: Callable[[int, int], None]
) -> dict[str, Any]:
    """Fast against dense EquiIGD on frames 0 to `frames` - 1; with `json_path`, FILE's .pairs.jsonl resumes.

    Raises:
        EvgError: weights or frames cannot be read, or the journal is another comparison's.
    """
    planner = GraspPlanner.load("equiigd", weights)
    settings = f"{planner.weights_sha256} {VERSION} {planner.config}"
    header = {"digest": hashlib.sha256(settings.encode()).hexdigest()[:16], "weights_sha256": planner.weights_sha256}
    journal = None if json_path is None else Journal(json_path.with_suffix(".pairs.jsonl"), header, Pair)
    pairs = [] if journal is None else journal.rows
    done = {row.frame for row in pairs}
    for number in range(frames):
        if number not in done:
            one = pair(planner, number, load_frame(number))
            journal.append(one) if journal is not None else pairs.append(one)
            if len(pairs) % 25 == 0:
                progress(len(pairs), frames)
    return summary([row for row in pairs if row.frame < frames], planner.weights_sha256)


def summary(pairs: list[Pair], weights_sha256: str) -> dict[str, Any]:
    """The facts of a comparison."""
    lost = [row.score_dense - row.score_fast for row in pairs]
    return {
        "weights_sha256": weights_sha256,
        "frames": len(pairs),
        "agree": sum(row.agree for row in pairs),
        "same_place": sum(row.same_place for row in pairs),
        "score_tolerance": SCORE,
        "score_lost_mean": float(np.mean(lost)),
        "score_lost_p95": float(np.percentile(lost, 95)),
        "no_grasp_fast": sum(row.score_fast == 0.0 for row in pairs),
        "no_grasp_dense": sum(row.score_dense == 0.0 for row in pairs),
        "disagree": [row.to_dict() for row in pairs if not row.agree],
    }
