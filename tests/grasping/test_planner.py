"""The planner is deterministic, equivariant end to end, agrees with its dense reference, and is fast."""

import time

import numpy as np
import pytest
import torch

from evg_app.errors import BadInput, UnknownName, WeightsError
from evg_app.geometry import is_transform, rotation_about, translation
from evg_app.grasping import weights
from evg_app.grasping.load import MODELS, load_planner
from evg_app.grasping.planner import GraspPlanner, PlannerConfig
from evg_app.grasping.selection import antipodal_cosine
from evg_app.grasping.weights import WeightsCard, load_weights, save_weights, shipped_weights

SCORE_TOLERANCE = 1e-4
POSITION_TOLERANCE = 1e-9
"""[m]: grasp centres are voxel centres."""
COSINE_TOLERANCE = 1e-6
"""Of the angle between turned grasps: 1.4e-3 rad."""
MATCHED = 0.95
"""Least share of grasps with a turned partner; the rest may swap at the cut after the K best (float32 ties)."""
TIME_BOUND = 1.5
"""[s], on a busy test machine; measured 0.13."""

ANY_SCORE = PlannerConfig(threshold=0.05)
CENTRE = translation(0.15, 0.15, 0.0)
QUARTER = CENTRE @ rotation_about("z", np.pi / 2) @ translation(-0.15, -0.15, 0.0)


def planner(networks, name="equiigd", config=ANY_SCORE):
    """A planner on a random network."""
    return GraspPlanner(networks[name], name=name, config=config)


def partners(T, found, score, found_score):
    """Whether each grasp T (N, 4, 4) has an equal one among `found` (M, 4, 4), up to the exchange of the fingers."""
    near = np.linalg.norm(T[:, None, :3, 3] - found[None, :, :3, 3], axis=-1) < POSITION_TOLERANCE
    alike = antipodal_cosine(T, found) > 1 - COSINE_TOLERANCE
    scored = np.abs(score[:, None] - found_score[None]) < SCORE_TOLERANCE
    return (near & alike & scored).any(axis=1)


def assert_turned(planner, values):
    """Plans on the turned scene are the turned plans, for three quarter turns."""
    reference = planner.plan(values, seed=4)
    assert len(reference) > 20
    T = reference.T_task_grasp
    for turns in (1, 2, 3):
        T = QUARTER @ T
        plan = planner.plan(np.ascontiguousarray(np.rot90(values, turns, axes=(0, 1))), seed=4)
        matched = partners(T, plan.T_task_grasp, reference.score, plan.score)
        assert matched[:10].all() and matched.mean() > MATCHED


@pytest.mark.parametrize("name", ["equiigd", "equigiga"])
def test_plans_turn_with_the_scene_end_to_end_on_random_weights(networks, grid, name):
    torch.set_num_threads(1)
    assert networks[name].config.side == "exact"
    assert_turned(planner(networks, name), grid.values)


@pytest.mark.parametrize("name", shipped_weights())
def test_plans_turn_with_the_scene_on_shipped_weights(grid, name):
    net, card = load_weights(name)
    if card.config.get("side") != "exact":
        pytest.skip(f"{name} has the published side branch, which is not equivariant")
    assert_turned(GraspPlanner(net, name=card.architecture, config=ANY_SCORE), grid.values)


@pytest.mark.parametrize("name", ["equiigd", "equigiga"])
def test_grasps_are_ranked_rigid_and_inside_the_workspace(networks, grid, name):
    grasps = planner(networks, name).plan(grid)
    assert len(grasps) > 20
    assert grasps.T_task_grasp.dtype == np.float64 and grasps.T_task_grasp.shape == (len(grasps), 4, 4)
    assert all(is_transform(T) for T in grasps.T_task_grasp)
    assert (np.diff(grasps.score) <= 0).all() and (grasps.score >= 0.05).all() and (grasps.score <= 1).all()
    assert ((grasps.width >= 0.0099) & (grasps.width <= 0.0699)).all()
    voxel = grasps.T_task_grasp[:, :3, 3] / 0.0075 - 0.5
    assert np.abs(voxel - voxel.round()).max() < 1e-6


def test_a_seed_fixes_the_plan_and_another_seed_draws_other_rotations(networks, grid):
    flow_only = planner(networks)
    first, again, other = (flow_only.plan(grid, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.T_task_grasp, again.T_task_grasp) and np.array_equal(first.score, again.score)
    assert not np.array_equal(first.T_task_grasp, other.T_task_grasp)


def test_a_bare_array_is_as_good_as_a_fused_grid(networks, grid):
    third_party = planner(networks).plan(np.array(grid.values))
    assert np.array_equal(third_party.T_task_grasp, planner(networks).plan(grid).T_task_grasp)


@pytest.mark.parametrize("name", [pytest.param("equiigd", marks=pytest.mark.slow), "equigiga"])
def test_with_an_unlimited_budget_coarse_to_fine_is_the_dense_reference(networks, grid, name):
    everything = PlannerConfig(
        refined=8_000, blocks=8_000, points=64_000, per_block=8, sampled=64_000, threshold=0.05, samples=1, steps=1
    )
    thrifty = planner(networks, name, everything)
    plan, dense = thrifty.plan(grid), thrifty.plan_dense(grid)
    top = slice(0, 50)
    matched = partners(dense.T_task_grasp[top], plan.T_task_grasp, dense.score[top], plan.score)
    assert len(dense) > 50 and matched.all()


def test_the_threshold_and_the_width_decide_what_is_returned(networks, grid):
    assert len(planner(networks, config=PlannerConfig(threshold=0.999)).plan(grid)) == 0
    strict, loose = (planner(networks, config=PlannerConfig(threshold=t)).plan(grid) for t in (0.55, 0.05))
    assert len(strict) < len(loose) and (strict.score >= 0.55).all()


@pytest.mark.parametrize("model", ["equiigd", "antipodal", "random"])
def test_an_empty_view_gives_no_grasp_and_no_crash(networks, model):
    p = planner(networks) if model == "equiigd" else load_planner(model)
    assert len(p.plan(np.zeros((40, 40, 40), np.float32))) == 0


@pytest.mark.parametrize("model", ["equiigd", "antipodal", "random"])
@pytest.mark.parametrize("bad", [np.zeros((40, 40)), np.full((40, 40, 40), np.nan), np.full((40, 40, 40), 2.0)])
def test_a_grid_that_is_none_is_refused(networks, model, bad):
    p = planner(networks) if model == "equiigd" else load_planner(model)
    with pytest.raises(BadInput, match="grid"):
        p.plan(bad.astype(np.float32))


def test_planners_load_by_name_and_unknown_ones_say_what_exists(tmp_path, monkeypatch, networks, grid):
    net = networks["equigiga"]
    card = save_weights(tmp_path, net, WeightsCard("equigiga", "equigiga", net.config.to_dict(), "", 0))
    monkeypatch.setattr(weights, "WEIGHTS_DIR", tmp_path)
    loaded = load_planner("equigiga", config=ANY_SCORE)
    assert loaded.name == "equigiga" and loaded.weights_sha256 == card.sha256
    assert np.array_equal(loaded.plan(grid).score, planner(networks, "equigiga").plan(grid).score)
    with pytest.raises(WeightsError, match="Shipped weights: equigiga"):
        load_planner("equiigd")
    with pytest.raises(WeightsError, match="for the model 'equigiga', not 'equiigd'"):
        load_planner("equiigd", weights="equigiga")
    with pytest.raises(UnknownName) as caught:
        load_planner("nothing")
    assert caught.value.known == list(MODELS)
    with pytest.raises(BadInput, match="takes no weights"):
        load_planner("antipodal", weights="equigiga")


def test_an_unusable_device_is_refused(networks):
    with pytest.raises(BadInput, match="device"):
        GraspPlanner(networks["equiigd"], name="equiigd", device="toaster")


def test_a_plan_takes_a_fraction_of_a_second(networks, grid):
    torch.set_num_threads(1)
    p = planner(networks)
    p.plan(grid)
    start = time.perf_counter()
    p.plan(grid)
    assert time.perf_counter() - start < TIME_BOUND
