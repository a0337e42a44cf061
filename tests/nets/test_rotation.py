"""Six numbers to a rotation: exact on rotations, nearest otherwise, commuting with turns; the antipodal twin."""

import math

import pytest
import torch

from evg_app.nets.flow import nearest_target
from evg_app.nets.rotation import flip, from_rows, rows_to_vectors, to_rows, turn_scene, vectors_to_rows

ATOL = 1e-5
ATOL64 = 1e-9


@pytest.fixture
def rows():
    return torch.randn(1000, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(0))


def gram_schmidt(rows):
    r1 = torch.nn.functional.normalize(rows[..., :3], dim=-1)
    r2 = rows[..., 3:] - (r1 * rows[..., 3:]).sum(-1, keepdim=True) * r1
    r2 = torch.nn.functional.normalize(r2, dim=-1)
    return torch.stack([r1, r2, torch.linalg.cross(r1, r2)], -2)


def test_six_numbers_give_a_rotation_and_back(rows):
    R = from_rows(rows)
    eye = torch.eye(3, dtype=torch.float64).expand_as(R)
    torch.testing.assert_close(R @ R.transpose(-1, -2), eye, atol=1e-6, rtol=0)
    assert (torch.linalg.det(R) > 0.999).all()
    torch.testing.assert_close(from_rows(to_rows(R)), R, atol=1e-6, rtol=0)


def test_closed_form_is_the_polar_factor(rows):
    u, _, vh = torch.linalg.svd(rows.view(-1, 2, 3), full_matrices=False)
    torch.testing.assert_close(from_rows(rows)[:, :2], u @ vh, atol=1e-6, rtol=0)


def test_polar_commutes_with_turns_where_gram_schmidt_does_not(rows, turn):
    turned = turn["rows"](rows, 1)
    torch.testing.assert_close(from_rows(turned), turn["rotation"](from_rows(rows), 1), atol=ATOL64, rtol=0)
    error = (gram_schmidt(turned) - turn["rotation"](gram_schmidt(rows), 1)).abs().amax((1, 2))
    assert error.max() > 1.0
    assert error.median() > 0.3


@pytest.mark.parametrize("bad", [[0.0] * 6, [1.0, 2.0, 3.0, 1.0, 2.0, 3.0], [1e-8] * 3 + [1.0] * 3])
def test_degenerate_numbers_keep_value_and_gradient_finite(bad):
    rows = torch.tensor(bad, requires_grad=True)
    R = from_rows(rows)
    R.sum().backward()
    assert R.isfinite().all()
    assert rows.grad is not None
    assert rows.grad.isfinite().all()


def test_orders_of_the_six_numbers_are_inverse_and_columns_are_vectors(rows):
    torch.testing.assert_close(vectors_to_rows(rows_to_vectors(rows)), rows)
    R = from_rows(rows)
    torch.testing.assert_close(rows_to_vectors(to_rows(R)).view(-1, 3, 2), R[:, :2].transpose(1, 2))


def test_flip_turns_half_way_about_the_approach(rows):
    half = torch.diag(torch.tensor([-1.0, -1.0, 1.0], dtype=torch.float64))
    R = from_rows(rows)
    torch.testing.assert_close(flip(R), R @ half)
    torch.testing.assert_close(flip(flip(R)), R)


def test_nearest_target_is_the_nearer_twin_and_does_not_depend_on_which_is_given(rows):
    noise, R = rows[:500], from_rows(rows[500:])
    target = nearest_target(noise, R)
    torch.testing.assert_close(target, nearest_target(noise, flip(R)))
    given = (noise - to_rows(R)).norm(dim=-1)
    twin = (noise - to_rows(flip(R))).norm(dim=-1)
    torch.testing.assert_close((noise - target).norm(dim=-1), torch.minimum(given, twin))


def test_turn_of_the_scene_is_a_quarter_about_z():
    angle = math.pi / 2
    Rz = torch.tensor([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]])
    p = torch.randn(10, 3)
    torch.testing.assert_close(turn_scene(p, 1), p @ Rz.T, atol=ATOL, rtol=0)
    torch.testing.assert_close(turn_scene(p, 4), p)
