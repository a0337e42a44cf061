"""Every C4 layer commutes with the turn of its input; cached filters are the trained ones."""

import copy

import pytest
import torch

from evg_app.nets.c4 import C4Linear, LiftConv2d, RegularConv2d
from evg_app.nets.fibres import Fibre, turn_fibre
from evg_app.nets.lift import LiftAndProject

ATOL = 1e-5
TURNS = (1, 2, 3)
MIXED = Fibre(reg=3, triv=2, vec=2)


def turn_plane(x: torch.Tensor, reg: int, turns: int) -> torch.Tensor:
    moved = torch.rot90(x, turns, (2, 3)).movedim(1, -1)
    return turn_fibre(moved, Fibre(reg=reg), turns).movedim(-1, 1)


def with_bias(layer: torch.nn.Module) -> torch.nn.Module:
    with torch.no_grad():
        layer.bias.free.normal_(generator=torch.Generator().manual_seed(1))
    return layer


@pytest.mark.parametrize("turns", TURNS)
@pytest.mark.parametrize("kernel", [1, 3])
def test_regular_convolution_commutes_with_turns(turns, kernel):
    layer = with_bias(RegularConv2d(2, 3, kernel))
    x = torch.randn(2, 8, 12, 12)
    torch.testing.assert_close(layer(turn_plane(x, 2, turns)), turn_plane(layer(x), 3, turns), atol=ATOL, rtol=0)


@pytest.mark.parametrize("turns", TURNS)
def test_lift_of_invariant_planes_commutes_with_turns(turns):
    layer = with_bias(LiftConv2d(3, 2))
    x = torch.randn(2, 3, 12, 12)
    expected = turn_plane(layer(x), 2, turns)
    torch.testing.assert_close(layer(torch.rot90(x, turns, (2, 3))), expected, atol=ATOL, rtol=0)


@pytest.mark.parametrize("turns", TURNS)
@pytest.mark.parametrize("source", [MIXED, Fibre(reg=2), Fibre(triv=3, vec=1), Fibre(vec=3)])
@pytest.mark.parametrize("target", [MIXED, Fibre(reg=2), Fibre(vec=3)])
def test_linear_map_commutes_with_turns(source, target, turns):
    layer = C4Linear(source, target)
    if layer.bias is not None:
        with_bias(layer)
    x = torch.randn(50, source.size)
    torch.testing.assert_close(
        layer(turn_fibre(x, source, turns)), turn_fibre(layer(x), target, turns), atol=ATOL, rtol=0
    )


def test_linear_map_has_the_free_numbers_of_the_intertwiner_space():
    layer = C4Linear(MIXED, MIXED)
    reg, triv, vec = MIXED.reg, MIXED.triv, MIXED.vec
    free = 4 * reg * reg + 2 * reg * triv + triv * triv + 4 * reg * vec + 2 * vec * vec
    assert layer.matrix.free.numel() == free
    assert layer.bias.free.numel() == reg + triv
    expanded = torch.stack([row(layer, i) for i in range(free)]).flatten(1)
    assert torch.linalg.matrix_rank(expanded) == free


def row(layer: C4Linear, i: int) -> torch.Tensor:
    single = copy.deepcopy(layer.matrix)
    with torch.no_grad():
        single.free.zero_()
        single.free[i] = 1.0
    return single.expand()


def test_lift_and_projection_equals_conv3d_relu_and_means():
    layer = with_bias(LiftAndProject(3))
    grid = torch.rand(2, 1, 12, 10, 20)
    got = layer(grid)
    weight = layer.filter.expand()
    lifted = torch.relu(torch.nn.functional.conv3d(grid, weight, layer.bias.expand(), padding=1))
    want = lifted.mean(4), lifted.mean(3), lifted.mean(2)
    probes = [torch.randn_like(w) for w in want]
    gradients = []
    for planes in (got, want):
        total = sum((plane * probe).sum() for plane, probe in zip(planes, probes, strict=True))
        gradients.append(torch.autograd.grad(total, [layer.filter.free, layer.bias.free]))
    for g, w in zip(got, want, strict=True):
        torch.testing.assert_close(g, w, atol=ATOL, rtol=0)
    for g, w in zip(*gradients, strict=True):
        torch.testing.assert_close(g, w, atol=1e-4, rtol=1e-4)


def test_lift_rejects_a_grid_without_channel_axis():
    with pytest.raises(ValueError, match=r"\(B, 1, X, Y, Z\)"):
        LiftAndProject(2)(torch.zeros(2, 40, 40, 40))


def test_cached_filters_equal_trained_ones_and_follow_their_changes():
    layer = with_bias(RegularConv2d(2, 2)).eval()
    x = torch.randn(1, 8, 8, 8)
    trained = layer(x)
    with torch.no_grad():
        first, kept = layer.filter(), layer.filter()
        assert first.data_ptr() == kept.data_ptr(), "the expanded filter is not kept"
        assert torch.equal(layer(x), trained)
        layer.filter.free.mul_(2.0)
        assert torch.equal(layer.filter(), 2.0 * first), "an in-place change of the weights is not seen"
        layer.load_state_dict({k: torch.zeros_like(v) for k, v in layer.state_dict().items()})
        assert not layer(x).any(), "loaded weights are not seen"
        layer.filter.free.data.fill_(1.0)
        layer.train().eval()
        assert layer.filter().eq(1.0).all(), "train() does not forget the filter"


def test_cached_filter_is_not_used_while_gradients_are_wanted():
    layer = RegularConv2d(1, 1).eval()
    with torch.no_grad():
        layer.filter()
    layer(torch.randn(1, 4, 8, 8)).sum().backward()
    assert layer.filter.free.grad is not None
