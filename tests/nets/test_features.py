"""Reading the planes equals grid_sample, in value and gradient, and hits voxel centres exactly."""

import pytest
import torch
import torch.nn.functional as F

from evg_app.nets.features import Features, sample, sample_weighted
from evg_app.nets.rows import weighted_rows

ATOL64 = 1e-9


def by_grid_sample(planes, points):
    _, batch, n, _, channels = planes.shape
    images = planes.permute(0, 1, 4, 2, 3).reshape(3 * batch, channels, n, n)
    grid = 2 * torch.stack([points[..., [1, 0]], points[..., [2, 0]], points[..., [2, 1]]])
    read = F.grid_sample(images, grid.reshape(3 * batch, 1, -1, 2), padding_mode="border", align_corners=False).view(
        3, batch, channels, -1
    )
    return torch.cat([read[0], read[1] + read[2]], 1).transpose(1, 2)


@pytest.fixture
def planes():
    g = torch.Generator().manual_seed(0)
    return torch.randn(3, 2, 40, 40, 5, dtype=torch.float64, generator=g).requires_grad_()


@pytest.fixture
def points():
    g = torch.Generator().manual_seed(1)
    return ((torch.rand(2, 70, 3, dtype=torch.float64, generator=g) - 0.5) * 1.2).requires_grad_()


def test_reading_equals_grid_sample_with_gradients(planes, points):
    got, want = sample(Features(planes), points), by_grid_sample(planes, points)
    probe = torch.randn_like(want)
    torch.testing.assert_close(got, want, atol=ATOL64, rtol=0)
    for g, w in zip(
        torch.autograd.grad((got * probe).sum(), (planes, points)),
        torch.autograd.grad((want * probe).sum(), (planes, points)),
        strict=True,
    ):
        torch.testing.assert_close(g, w, atol=ATOL64, rtol=1e-9)


def test_weighted_reading_is_the_weighted_sum_of_readings(planes, points):
    weights = torch.randn(2, 10, 7, dtype=torch.float64, requires_grad=True)
    got = sample_weighted(Features(planes), points.reshape(2, 10, 7, 3), weights)
    want = (sample(Features(planes), points).reshape(2, 10, 7, -1) * weights[..., None]).sum(2)
    torch.testing.assert_close(got, want, atol=ATOL64, rtol=0)
    for g, w in zip(
        torch.autograd.grad(got.square().sum(), (planes, points, weights)),
        torch.autograd.grad(want.square().sum(), (planes, points, weights)),
        strict=True,
    ):
        torch.testing.assert_close(g, w, atol=ATOL64, rtol=1e-9)


def test_a_voxel_centre_reads_its_pixel_exactly(planes):
    i, j, k = 3, 17, 39
    centre = (torch.tensor([[[i, j, k]]], dtype=torch.float64) + 0.5) / 40 - 0.5
    read = sample(Features(planes[:, :1]), centre)[0, 0]
    torch.testing.assert_close(read[:5], planes[0, 0, i, j])
    torch.testing.assert_close(read[5:], planes[1, 0, i, k] + planes[2, 0, j, k])


def test_points_outside_read_the_border(planes):
    outside = torch.full((2, 1, 3), 3.0, dtype=torch.float64)
    edge = torch.full((2, 1, 3), 0.5 - 0.5 / 40, dtype=torch.float64)
    torch.testing.assert_close(sample(Features(planes), outside), sample(Features(planes), edge))


def test_features_are_indexed_by_scene(planes, points):
    features = Features(planes)
    assert features.batch == 2
    whole = sample(features, points)
    for picked in (1, slice(1, 2), torch.tensor([1])):
        torch.testing.assert_close(sample(features[picked], points[1:]), whole[1:])
    assert not features.detach().planes.requires_grad


def test_points_must_come_in_one_set_per_scene(planes):
    with pytest.raises(ValueError, match="one set per scene"):
        sample(Features(planes), torch.zeros(3, 4, 3, dtype=torch.float64))


def test_rows_read_by_nobody_get_no_gradient():
    table = torch.randn(6, 3, requires_grad=True)
    index = torch.tensor([[0, 5], [5, 2]], dtype=torch.int32)
    weighted_rows(table, index, torch.ones(2, 2)).sum().backward()
    assert table.grad is not None
    assert table.grad[:, 0].tolist() == [1.0, 0.0, 1.0, 0.0, 0.0, 2.0]
