"""The planners under the clock: each from one depth image to sorted grasps, saying when a stage is over."""

from collections.abc import Callable
from dataclasses import dataclass

import torch

from evg_app.benchmark.latency.frames import CAMERA, DEPTH_SCALE, DepthFrame
from evg_app.grasping.load import LEARNED, load_planner
from evg_app.grasping.planner import GraspPlanner, Lap
from evg_app.grasping.protocol import Planner
from evg_app.grasping.weights import shipped_weights
from evg_app.nets.registry import build
from evg_app.perception.tsdf import fuse_depth
from evg_app.types import Grasps

NAMES = ("equiigd", "equigiga", "equiigd-dense", "giga", "vgn")
"""Rows of the table."""
RANDOM_SEED = 0
"""Of the weights where none are given or shipped."""


@dataclass(frozen=True)
class Subject:
    """One row of the table.

    Attributes:
        planner: with its weights.
        run: depth image to grasps; hears `lap` of its stages.
        random_weights: whether the weights are random: times mean something then, grasps nothing.
    """

    planner: Planner
    run: Callable[[DepthFrame, Lap], Grasps]
    random_weights: bool


def model_of(name: str) -> str:
    """The model that a row's name means."""
    return name.removesuffix("-dense")


def subject(name: str, weights: str | None, device: str = "cpu") -> Subject:
    """The planner of a row, with weights given, shipped, or else random.

    Raises:
        EvgError: see `load_planner`.
    """
    model = model_of(name)
    random = weights is None and model not in shipped_weights()
    planner = _random(model, device) if random else load_planner(model, weights, device)

    def run(frame: DepthFrame, lap: Lap) -> Grasps:
        """Fuse and plan."""
        grid = fuse_depth(frame.depth, CAMERA, frame.T_cam_task, DEPTH_SCALE)
        lap("fuse")
        if isinstance(planner, GraspPlanner):
            plan = planner.plan_dense if name.endswith("-dense") else planner.plan
            return plan(grid, 0, lap)
        grasps = planner.plan(grid)
        lap("plan")
        return grasps

    return Subject(planner, run, random)


def _random(model: str, device: str) -> Planner:
    """A planner with random weights."""
    with torch.random.fork_rng():
        torch.manual_seed(RANDOM_SEED)
        if model in LEARNED:
            return GraspPlanner(build(model), name=model, device=device)
        from evg_app.grasping.giga import GigaPlanner  # late: not what a first grasp waits for
        from evg_app.grasping.vgn import VgnPlanner
        from evg_app.nets.giga import GIGA
        from evg_app.nets.vgn import VGN

        return GigaPlanner(GIGA(), device=device) if model == "giga" else VgnPlanner(VGN(), device=device)
