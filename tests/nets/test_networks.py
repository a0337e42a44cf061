"""Whole networks: exact symmetry of every output with S2TP on and random weights, sizes, gradients, configs."""

import dataclasses
import json

import numpy as np
import pytest
import torch

from evg_app.errors import UnknownName
from evg_app.grasping.planner import GraspPlanner, PlannerConfig
from evg_app.grasping.weights import load_weights, shipped_weights
from evg_app.nets.config import EquiGIGAConfig, EquiIGDConfig, plain_counterpart
from evg_app.nets.equigiga import EquiGIGA
from evg_app.nets.equiigd import EquiIGD
from evg_app.nets.registry import NAMES, build
from evg_app.nets.rotation import flip, from_rows
from evg_app.nets.triplane import SideToPlane

EQUALLY_MANY = 0.02
EXACT = 1e-4
NOT_EXACT = 1e-2
TURNS = (1, 2, 3)


def outputs(net, s):
    """Every output; those that turn with the scene are named rows_ or R_."""
    f = net.encode(s.grid)
    out = {
        "graspness": net.graspness(f, s.points),
        "width": net.width(f, s.points),
        "occupancy": net.occupancy(f, s.points),
        "rows_regressed": net.regress_rotation(f, s.points),
    }
    if isinstance(net, EquiIGD):
        c = net.rotation_context(f, s.points)
        out["score"] = net.grasp_score(f, s.points, s.rotation)
        out["rows_velocity"] = net.velocity(c, s.noise, torch.full(s.points.shape[:2], 0.3))
        out["R_flow"] = net.sample_rotation(f, s.points, s.noise, steps=4)
    return out


def turned_errors(net, s, turns, turn):
    """Largest change per output, relative to its largest value where that is above 1."""
    before, after = outputs(net, s), outputs(net, s.turned(turns))
    errors = {}
    for name, value in before.items():
        if name.startswith("rows_"):
            value = turn["rows"](value, turns)
        if name.startswith("R_"):
            value = turn["rotation"](value, turns)
        errors[name] = ((after[name] - value).abs().max() / value.abs().max().clamp(min=1.0)).item()
    return errors


@pytest.mark.parametrize("turns", TURNS)
@pytest.mark.parametrize("name", NAMES)
def test_every_output_turns_exactly_with_the_scene(name, turns, scene, turn, randomised):
    net = randomised(build(name, {"side": "exact"})).eval()
    with torch.no_grad():
        spread = {k: v.std().item() for k, v in outputs(net, scene).items()}
        errors = turned_errors(net, scene, turns, turn)
    assert min(spread.values()) > NOT_EXACT, spread
    assert max(errors.values()) < EXACT, errors


@pytest.mark.parametrize("turns", TURNS)
@pytest.mark.parametrize("name", shipped_weights())
def test_every_output_of_the_shipped_weights_turns_exactly_with_the_scene(name, turns, scene, turn):
    net, card = load_weights(name)
    assert card.config["side"] == "exact"
    with torch.no_grad():
        errors = turned_errors(net.eval(), scene, turns, turn)
    assert max(errors.values()) < EXACT, errors


@pytest.mark.parametrize("name", NAMES)
def test_published_side_branch_is_not_exact(name, scene, turn, randomised):
    """An ordinary U-Net does not follow the mirrored planes, and S2TP carries that into the xy branch."""
    net = randomised(build(name, {"side": "mixed"})).eval()
    with torch.no_grad():
        errors = turned_errors(net, scene, 1, turn)
    assert min(errors.values()) > NOT_EXACT, errors


@pytest.mark.parametrize("name", NAMES)
def test_rotations_are_orthonormal_and_turn_with_the_scene_in_double_precision(name, scene, turn):
    """In double precision no point is left out, however near to parallel its rows are."""
    net, other = build(name).double().eval(), scene.turned(1)
    with torch.no_grad():
        R = net.rotation(net.encode(scene.grid.double()), scene.points.double())
        turned = net.rotation(net.encode(other.grid.double()), other.points.double())
    torch.testing.assert_close(R @ R.transpose(-1, -2), torch.eye(3, dtype=R.dtype).expand_as(R), atol=1e-9, rtol=0)
    torch.testing.assert_close(turned, turn["rotation"](R, 1), atol=1e-7, rtol=0)


def test_grasp_score_is_the_same_for_both_fingers_orders(scene, randomised):
    net = randomised(EquiIGD()).eval()
    with torch.no_grad():
        f = net.encode(scene.grid)
        one, twin = (net.grasp_score(f, scene.points, R) for R in (scene.rotation, flip(scene.rotation)))
        torch.testing.assert_close(one, twin, atol=EXACT, rtol=0)
        free = randomised(EquiIGD(EquiIGDConfig(antipodal_score=False))).eval()
        f = free.encode(scene.grid)
        one, twin = (free.grasp_score(f, scene.points, R) for R in (scene.rotation, flip(scene.rotation)))
        assert (one - twin).abs().max() > 10 * EXACT


def test_grasp_score_depends_on_the_rotation(scene, randomised):
    net = randomised(EquiIGD()).eval()
    with torch.no_grad():
        f = net.encode(scene.grid)
        a = net.grasp_score(f, scene.points, scene.rotation)
        b = net.grasp_score(f, scene.points, scene.rotation.flip(1))
    assert (a - b).abs().max() > 10 * EXACT


def count(module: torch.nn.Module) -> int:
    return sum(p.numel() for p in module.parameters())


def test_parameter_counts_are_those_of_the_paper_with_free_filters():
    """Free C4 filters have 36 numbers per pair of copies where escnn's default keeps 24 (lift: 27, 10)."""
    backbone = EquiGIGA().backbone
    assert count(backbone) == 681_280
    pairs_3x3 = sum(
        m.filter.free.numel() // 36
        for m in backbone.modules()
        if getattr(m, "padding", None) == 1 and hasattr(m, "filter")
    )
    assert count(backbone) - 12 * pairs_3x3 - 8 * 17 == 617_400, "not the published 617,400 with escnn's filters"
    assert count(EquiGIGA()) == 830_339
    published = EquiGIGA(EquiGIGAConfig(side_hidden=32, side_blocks=5))
    assert count(published) == 937_571
    assert count(EquiIGD()) == 878_631
    assert count(EquiIGD(EquiIGDConfig(regressed_rotation=False))) == 861_895


@pytest.mark.parametrize("side", ["exact", "mixed"])
def test_all_parameters_get_finite_gradients(side, scene):
    net = EquiIGD(EquiIGDConfig(side=side))
    total = sum(value.square().mean() for value in outputs(net, scene).values())
    total.backward()
    for name, p in net.named_parameters():
        if name == "score_attention.to_key.bias.free":  # the softmax does not see a common shift of all keys
            continue
        assert p.grad is not None, name
        assert p.grad.isfinite().all(), name
        assert p.grad.any(), name


def test_eval_with_kept_filters_equals_training_mode(scene):
    net = EquiIGD()
    trained = outputs(net, scene)
    net.eval()
    with torch.no_grad():
        for _ in range(2):
            for name, value in outputs(net, scene).items():
                torch.testing.assert_close(value, trained[name], atol=EXACT, rtol=1e-4)


def test_flow_reaches_its_target_when_the_velocity_is_right(scene, monkeypatch):
    """Euler integration of r1 - r0 ends at r1 for any number of steps."""
    net = EquiIGD().eval()
    target = scene.rotation
    velocity = target[..., :2, :].flatten(-2) - scene.noise
    monkeypatch.setattr(net.flow, "velocity", lambda prepared, r, t: velocity)
    with torch.no_grad():
        f = net.encode(scene.grid)
        for steps in (1, 3, 10):
            R = net.sample_rotation(f, scene.points, scene.noise, steps)
            torch.testing.assert_close(R, target, atol=EXACT, rtol=0)


def test_sampling_integrates_the_velocity_that_is_trained(scene):
    net = EquiIGD().eval()
    with torch.no_grad():
        c = net.rotation_context(net.encode(scene.grid), scene.points)
        r = scene.noise
        for step in range(3):
            r = r + net.velocity(c, r, torch.full(r.shape[:2], step / 3)) / 3
        torch.testing.assert_close(net.sample_from_context(c, scene.noise, 3), from_rows(r), atol=EXACT, rtol=0)


def test_scale_of_all_outputs_is_of_order_one_at_the_start():
    torch.manual_seed(0)
    grid = torch.zeros(1, 1, 40, 40, 40)
    grid[..., 3:11] = torch.linspace(0.1, 0.98, 8)
    grid[0, 0, 12:22, 14:26, 8:20] = torch.rand(10, 12, 12)
    points = torch.rand(1, 200, 3) - 0.5
    for name in NAMES:
        net = build(name).eval()
        with torch.no_grad():
            f = net.encode(grid)
            values = [net.graspness(f, points), net.width(f, points), net.occupancy(f, points)]
            values.append(net.regress_rotation(f, points))
        for v in values:
            assert 1e-3 < v.abs().max() < 10.0


def test_a_network_without_regressed_rotation_says_so(scene):
    net = EquiIGD(EquiIGDConfig(regressed_rotation=False)).eval()
    with torch.no_grad(), pytest.raises(ValueError, match="regressed_rotation=True"):
        net.regress_rotation(net.encode(scene.grid), scene.points)


@pytest.mark.parametrize("name", NAMES)
def test_config_survives_a_card_and_builds_the_same_network(name):
    net = build(name, {"side": "mixed"})
    card = json.loads(json.dumps(net.config.to_dict()))
    again = build(name, card)
    assert again.config == net.config
    again.load_state_dict(net.state_dict())


@pytest.mark.parametrize("name", NAMES)
def test_the_plain_counterpart_has_as_many_parameters_no_symmetry_and_all_filters_learn(name, scene, turn):
    net = build(name, plain_counterpart(name)).eval()
    assert abs(count(net) / count(build(name)) - 1) < EQUALLY_MANY
    assert max(turned_errors(net, scene, 1, turn).values()) > NOT_EXACT
    sum(value.square().sum() for value in outputs(net, scene).values()).backward()
    dead = [key for key, p in net.named_parameters() if "free" in key and (p.grad is None or not p.grad.any())]
    assert dead in ([], ["score_attention.to_key.bias.free"])  # the same for all points: softmax ignores it
    build(name, json.loads(json.dumps(net.config.to_dict()))).load_state_dict(net.state_dict())


def test_unknown_names_and_keys_are_told():
    with pytest.raises(UnknownName, match="equigiga, equiigd"):
        build("vgn")
    with pytest.raises(ValueError, match="hiden"):
        build("equiigd", {"hiden": 3})
    with pytest.raises(ValueError, match="exact, mixed"):
        build("equiigd", {"side": "other"})
    with pytest.raises(dataclasses.FrozenInstanceError):
        EquiIGDConfig().hidden = 3  # type: ignore[misc]


def test_side_to_plane_on_lines_equals_the_1x1_map_of_the_broadcast_plane():
    join = SideToPlane(2, 5)
    with torch.no_grad():
        join.bias.free.normal_()
    xy, ax, ay = torch.randn(3, 8, 6, 7), torch.randn(3, 5, 6), torch.randn(3, 5, 7)
    plane = torch.cat([xy, ax[..., None] + ay[..., None, :]], 1).movedim(1, -1)
    want = (join.linear(plane) + join.bias()).movedim(-1, 1)
    torch.testing.assert_close(join(xy, ax, ay), want, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize(("part", "gone"), [("s2tp", "s2tp"), ("eda", "to_offsets")])
def test_a_part_can_be_left_out_and_the_symmetry_stays(part, gone, scene, turn, randomised):
    net = randomised(build("equiigd", {part: False})).eval()
    assert any(gone in key for key in build("equiigd").state_dict())
    assert not any(gone in key for key in net.state_dict())
    with torch.no_grad():
        assert max(turned_errors(net, scene, 1, turn).values()) < EXACT
    planner = GraspPlanner(net, name="equiigd", config=PlannerConfig(threshold=0.0))
    grid = scene.grid[0, 0].numpy()
    with torch.inference_mode():
        index, _ = planner.locate(planner.encode(grid), np.ones_like(grid, dtype=bool))
    assert len(index) == planner.config.points
