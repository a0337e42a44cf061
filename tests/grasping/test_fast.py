"""The fast path computes what the networks compute, whatever the number of threads."""

import copy

import numpy as np
import pytest
import torch
from scipy import ndimage

from evg_app.grasping import columns, lattice
from evg_app.grasping.fast.eager import EagerEncoder, EagerHeads
from evg_app.grasping.fast.encoder import FastEncoder
from evg_app.grasping.fast.field import Field
from evg_app.grasping.fast.heads import Place, heads_of
from evg_app.grasping.fast.lift import SparseLift
from evg_app.grasping.fast.workers import Workers, pieces
from evg_app.grasping.planner import GraspPlanner, PlannerConfig
from evg_app.nets.registry import build

EXPORT_TOLERANCE = 1e-4
"""Of every output against the eager network."""
ROTATION_SHARE = 0.98
"""Rotations within it; a few random ones come from nearly parallel rows, which magnify rounding."""
LIFT_TOLERANCE = 1e-6
CPU = torch.device("cpu")
VARIANTS = {
    "exact": ("equiigd", {}),
    "mixed": ("equiigd", {"side": "mixed", "antipodal_score": False}),
    "contact": ("equiigd", {"contact_score": True, "regressed_rotation": False}),
    "equigiga": ("equigiga", {}),
}


@pytest.fixture(scope="module", params=VARIANTS)
def net(request):
    name, config = VARIANTS[request.param]
    with torch.random.fork_rng():
        torch.manual_seed(1)
        return build(name, config).eval()


@pytest.fixture
def places(net, grid):
    """Some blocks and some voxels of the encoded scene."""
    rng = np.random.default_rng(0)
    with torch.inference_mode():
        field = Field(EagerEncoder(net, CPU)(grid.values))
    blocks = torch.from_numpy(rng.integers(0, lattice.BLOCKS**3, 75))
    return Place(field, blocks, lattice.BLOCKS), Place(field, torch.from_numpy(rng.integers(0, 64_000, 75)))


def test_the_exported_encoder_is_the_network_s(net, grid):
    with torch.inference_mode():
        reference, planes = EagerEncoder(net, CPU)(grid.values), FastEncoder(net.backbone, 2)(grid.values)
    assert reference.abs().max() > 0.1
    assert (planes - reference).abs().max() < EXPORT_TOLERANCE


@pytest.mark.parametrize("what", ["seen", "full", "empty"])
def test_the_sparse_lift_is_the_whole_one(networks, grid, what):
    lift = networks["equiigd"].backbone.lift
    rng = np.random.default_rng(0)
    values = {"seen": grid.values, "full": rng.random((40, 40, 40), np.float32), "empty": np.zeros_like(grid.values)}
    with torch.inference_mode():
        whole = lift(torch.tensor(values[what])[None, None])
        sparse = SparseLift(lift)(values[what])
    assert (sparse - torch.stack([p[0].permute(1, 2, 0) for p in whole])).abs().max() < LIFT_TOLERANCE


def test_on_an_accelerator_nothing_is_computed_from_what_stayed_behind(net, grid):
    """Torch's meta device stands in for a GPU: it computes shapes only, and refuses operands of two devices."""
    meta = torch.device("meta")
    with pytest.raises(RuntimeError, match="device"):
        torch.zeros(3, device=meta) + torch.zeros(3)
    there = copy.deepcopy(net).to(meta)
    with torch.inference_mode():
        field, heads = Field(EagerEncoder(there, meta)(grid.values)), EagerHeads(there)
        index = torch.arange(75, device=meta)
        for side in (lattice.BLOCKS, 40):
            assert heads.graspness(Place(field, index, side)).device == meta
        for answer in heads.grasps(Place(field, index), torch.empty(2, 75, 6, device=meta), 3):
            assert answer.device == meta


def test_the_folded_heads_say_what_the_networks_say(net, places):
    fast, eager = heads_of(net), EagerHeads(net)
    noise = torch.randn(2, 75, 6, generator=torch.Generator().manual_seed(0))
    with torch.inference_mode():
        for place in places:
            assert (fast.graspness(place) - eager.graspness(place)).abs().max() < EXPORT_TOLERANCE
        place = places[1]
        (rotation, score, width), (reference, wanted, opening) = (h.grasps(place, noise, 3) for h in (fast, eager))
    assert (width - opening).abs().max() < EXPORT_TOLERANCE
    assert rotation.shape == reference.shape and score.shape == wanted.shape
    off = (rotation - reference).abs().amax((2, 3))
    assert (off < EXPORT_TOLERANCE).float().mean() > ROTATION_SHARE
    assert ((score - wanted).abs().amax(-1) < EXPORT_TOLERANCE)[off < EXPORT_TOLERANCE].all()


def test_the_score_that_allows_contact_is_the_network_s_second(grid):
    with torch.random.fork_rng():
        torch.manual_seed(2)
        network = build("equiigd", {"contact_score": True}).eval()
    strict, lenient = (
        GraspPlanner(network, name="equiigd", config=PlannerConfig(allow_contact=allow)) for allow in (False, True)
    )
    index = np.arange(20_000, 20_040)
    with torch.inference_mode():
        field = strict.encode(grid.values)
        scores = [planner.orient(field, index, 0)[1] for planner in (strict, lenient)]
    assert np.abs(scores[0] - scores[1]).max() > 1e-3


def test_plans_are_the_same_with_any_number_of_threads(networks, grid):
    plans = []
    before = torch.get_num_threads()
    for threads in (1, 2, 3):
        torch.set_num_threads(threads)
        planner = GraspPlanner(networks["equiigd"], name="equiigd", config=PlannerConfig(threshold=0.05))
        plans.append(planner.plan(grid, 3))
        assert torch.get_num_threads() == threads, "planning leaves torch's setting alone"
    torch.set_num_threads(before)
    assert len(plans[0]) > 20
    for plan in plans[1:]:
        assert np.array_equal(plan.T_task_grasp, plans[0].T_task_grasp) and np.array_equal(plan.score, plans[0].score)


def test_a_planner_says_when_its_stages_are_over(networks, grid):
    stages = []
    GraspPlanner(networks["equiigd"], name="equiigd").plan(grid, lap=stages.append)
    assert stages == ["mask", "encode", "locate", "orient", "select"]


def test_without_a_cuda_device_planning_goes_on_with_a_warning(networks, grid, caplog, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    planner = GraspPlanner(networks["equigiga"], name="equigiga", device="cuda")
    assert "CUDA" in caplog.text and "cpu" in caplog.text
    assert len(planner.plan(grid)) > 0


@pytest.mark.parametrize("threads", [1, 3])
def test_workers_keep_the_order_and_pass_errors_on(threads):
    workers = Workers(threads)
    assert workers.map(lambda n: n * n, list(range(50))) == [n * n for n in range(50)]

    def fails(n):
        raise ZeroDivisionError(n)

    with pytest.raises(ZeroDivisionError):
        workers.map(fails, [1, 2, 3])


def test_workers_keep_torch_on_their_thread_and_leave_the_caller_s_setting():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    workers = Workers(3)
    assert set(workers.map(lambda n: torch.get_num_threads(), list(range(30)))) == {1}
    assert torch.get_num_threads() == 2
    torch.set_num_threads(before)


@pytest.mark.parametrize("count", [0, 1, 2, 5, 100, 101, 1999])
def test_pieces_cover_everything_once_and_are_even_in_number(count):
    found = pieces(count, 100)
    assert [i for piece in found for i in range(count)[piece]] == list(range(count))
    assert all(0 < piece.stop - piece.start <= 100 for piece in found)
    assert count < 2 or len(found) % 2 == 0


@pytest.mark.parametrize("radius", [1.0, 2.5, 8.0])
def test_growing_columns_is_thresholding_distance(radius):
    mask = np.random.default_rng(0).random((40, 40, 40)) < 0.002
    assert np.array_equal(columns.within(mask, radius), ndimage.distance_transform_edt(~mask) <= radius)
    assert np.array_equal(columns.with_neighbours(mask), ndimage.maximum_filter(mask, 3, mode="constant"))
