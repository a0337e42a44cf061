"""Planners by name."""

from dataclasses import replace
from pathlib import Path

from evg_app.errors import BadInput, UnknownName, WeightsError
from evg_app.grasping.antipodal import AntipodalPlanner
from evg_app.grasping.planner import GraspPlanner, PlannerConfig
from evg_app.grasping.protocol import Planner
from evg_app.grasping.random import RandomPlanner

LEARNED = ("equiigd", "equigiga")
"""Models that need weights."""
DENSE = tuple(f"{model}-dense" for model in LEARNED)
"""The same with the paper's dense search, the reference."""
PUBLISHED = ("giga", "vgn")
"""Models of others, for comparison; their official weights are not shipped."""
MODELS = (*LEARNED, *DENSE, *PUBLISHED, "antipodal", "random")
"""Names that `load_planner` knows."""


def load_planner(
    model: str = "equiigd",
    weights: str | Path | None = None,
    device: str = "cpu",
    config: PlannerConfig | None = None,
) -> Planner:
    """The planner of that name.

    Args:
        model: one of `MODELS`.
        weights: a shipped name or a `.safetensors` path; None for the shipped weights of the model's name. For the
            models in `PUBLISHED` the path of an official `.pt` file.
        device: where torch runs.
        config: how the learned planners search.

    Raises:
        UnknownName: no such model.
        WeightsError: weights missing, corrupt, or of another model.
        BadInput: weights given to a planner that has none, or an unusable device.
    """
    if model in LEARNED:
        return GraspPlanner.load(model, weights, device, config)
    if model in DENSE:
        dense = replace(config or PlannerConfig(), dense=True)
        return GraspPlanner.load(model.removesuffix("-dense"), weights, device, dense)
    if model in PUBLISHED:
        return _load_published(model, weights, device)
    if model not in MODELS:
        raise UnknownName("model", model, list(MODELS))
    if weights is not None:
        raise BadInput(f"the model '{model}' takes no weights, but got '{weights}'; leave out --weights")
    return AntipodalPlanner() if model == "antipodal" else RandomPlanner()


def _load_published(model: str, weights: str | Path | None, device: str) -> Planner:
    """A planner of others with its official weights; errors as `load_planner`."""
    if weights is None:
        raise WeightsError(
            f"the model '{model}' has no shipped weights; give its official .pt file with --weights FILE"
        )
    from evg_app.grasping.giga import GigaPlanner  # late: they load scipy, which the other models do without
    from evg_app.grasping.vgn import VgnPlanner

    path = Path(weights)
    return GigaPlanner.load(path, device) if model == "giga" else VgnPlanner.load(path, device)
