"""Our C4 layers against escnn 1.0.11: shared random filters, equal outputs.

escnn draws the filter, `project` finds our free numbers for it (exact only if escnn's filter obeys
our symmetry), then both layers see the same input. Runs in an environment of its own, see README.md.
"""

import pytest
import torch

escnn = pytest.importorskip("escnn", reason="escnn needs numpy 1 and an environment of its own: tests/oracle/README.md")

from escnn import group, gspaces  # noqa: E402
from escnn import nn as enn  # noqa: E402

from evg_app.nets.c4 import C4Linear, LiftConv2d, RegularConv2d  # noqa: E402
from evg_app.nets.expanded import ExpandedFilter  # noqa: E402
from evg_app.nets.fibres import Fibre  # noqa: E402
from evg_app.nets.lift import LiftAndProject  # noqa: E402

pytestmark = pytest.mark.oracle

ATOL = 1e-5
PLANE = gspaces.rot2dOnR2(4)
SOLID = gspaces.rot2dOnR3(4)
POINT = gspaces.no_base_space(group.cyclic_group(4))


@pytest.fixture(autouse=True)
def seeded():
    torch.manual_seed(0)
    torch.set_num_threads(1)


def project(ours: ExpandedFilter, full: torch.Tensor) -> float:
    """Set our free numbers to those of escnn's filter; the largest entry that they cannot express."""
    flat = full.detach().reshape(-1)
    sign = torch.ones_like(flat) if ours.sign is None else ours.sign
    total = torch.zeros(ours.free.numel()).index_add_(0, ours.index, flat * sign)
    count = torch.zeros(ours.free.numel()).index_add_(0, ours.index, sign.abs())
    with torch.no_grad():
        ours.free.copy_(total / count)
    return (ours.expand().reshape(-1) - flat).abs().max().item()


def randomise(layer: torch.nn.Module) -> torch.nn.Module:
    with torch.no_grad():
        for p in layer.parameters():
            p.normal_()
    return layer.eval()


def adopt(ours, full: torch.Tensor, bias: torch.Tensor) -> None:
    """Take filter and bias of escnn's layer, and check that both were expressible."""
    assert project(ours.filter, full) < ATOL
    assert project(ours.bias, bias) < ATOL


def expanded(theirs) -> tuple[torch.Tensor, torch.Tensor]:
    full, bias = theirs.expand_parameters()
    return full, bias


def field(space, fibre: Fibre):
    reps = [space.regular_repr] * fibre.reg + [space.trivial_repr] * fibre.triv + [space.irrep(1)] * fibre.vec
    return enn.FieldType(space, reps)


@pytest.mark.parametrize("kernel", [1, 3])
def test_regular_convolution_equals_escnn(kernel):
    source, target = field(PLANE, Fibre(reg=3)), field(PLANE, Fibre(reg=2))
    theirs = randomise(enn.R2Conv(source, target, kernel, padding=kernel // 2))
    ours = RegularConv2d(3, 2, kernel)
    adopt(ours, *expanded(theirs))
    x = torch.randn(2, 12, 14, 14)
    torch.testing.assert_close(ours(x), theirs(source(x)).tensor, atol=ATOL, rtol=1e-5)


def test_default_frequency_cutoff_leaves_24_of_our_36_numbers_and_none_of_ours_is_missing():
    one = field(PLANE, Fibre(reg=1))
    cut = enn.R2Conv(one, one, 3, padding=1, bias=False)
    assert (cut.weights.numel(), RegularConv2d(1, 1).filter.free.numel()) == (24, 36)
    basis = []
    for i in range(24):
        with torch.no_grad():
            cut.weights.zero_()
            cut.weights[i] = 1.0
        ours = RegularConv2d(1, 1)
        assert project(ours.filter, cut.expand_parameters()[0]) < ATOL
        basis.append(ours.filter.free.detach().clone())
    assert torch.linalg.matrix_rank(torch.stack(basis), atol=1e-4) == 24


def test_lift_of_invariants_equals_escnn():
    source, target = field(PLANE, Fibre(triv=4)), field(PLANE, Fibre(reg=2))
    theirs = randomise(enn.R2Conv(source, target, 3, padding=1))
    ours = LiftConv2d(4, 2)
    adopt(ours, *expanded(theirs))
    x = torch.randn(2, 4, 14, 14)
    torch.testing.assert_close(ours(x), theirs(source(x)).tensor, atol=ATOL, rtol=1e-5)


def test_lift_of_the_grid_equals_escnn():
    """escnn's axes are (z, y, x) with z and y pointing the other way (spec §2.1)."""
    source, target = field(SOLID, Fibre(triv=1)), field(SOLID, Fibre(reg=2))
    theirs = randomise(enn.R3Conv(source, target, 3, padding=1))
    full, bias = expanded(theirs)
    ours = LiftAndProject(2)
    grid = torch.randn(2, 1, 10, 10, 10)
    adopt(ours, to_xyz(full), bias)
    lifted = torch.relu(to_xyz(theirs(source(to_escnn(grid))).tensor))
    for plane, axis in zip(ours(grid), (4, 3, 2), strict=True):
        torch.testing.assert_close(plane, lifted.mean(axis), atol=ATOL, rtol=1e-5)


def to_escnn(volume: torch.Tensor) -> torch.Tensor:
    return volume.permute(0, 1, 4, 3, 2).flip(2, 3)


def to_xyz(volume: torch.Tensor) -> torch.Tensor:
    return volume.flip(2, 3).permute(0, 1, 4, 3, 2)


KINDS = [Fibre(reg=2), Fibre(triv=3), Fibre(vec=2), Fibre(reg=2, triv=3), Fibre(reg=1, triv=2, vec=2)]


PAIRS = [(s, t) for s in KINDS for t in KINDS if {s, t} != {Fibre(triv=3), Fibre(vec=2)}]  # no map between these


@pytest.mark.parametrize(("source", "target"), PAIRS, ids=str)
def test_linear_map_equals_escnn_with_as_many_free_numbers(source, target):
    theirs = enn.Linear(field(POINT, source), field(POINT, target))
    randomise(theirs)
    ours = C4Linear(source, target)
    assert ours.matrix.free.numel() == theirs.weights.numel()
    full, bias = expanded(theirs)
    assert project(ours.matrix, full) < ATOL
    if ours.bias is not None:
        assert project(ours.bias, bias) < ATOL
    x = torch.randn(20, source.size)
    torch.testing.assert_close(ours(x), theirs(field(POINT, source)(x)).tensor, atol=ATOL, rtol=1e-5)


def test_a_filter_without_symmetry_is_noticed():
    """The comparison itself can fail."""
    ours = RegularConv2d(2, 2)
    assert project(ours.filter, torch.randn(8, 8, 3, 3)) > 0.1
