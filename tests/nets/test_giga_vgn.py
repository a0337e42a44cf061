"""The two published baselines: sizes, names of their tensors, wiring, loading."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from evg_app.errors import WeightsError
from evg_app.grasping import published
from evg_app.grasping.giga import GigaPlanner
from evg_app.grasping.load import load_planner
from evg_app.grasping.protocol import Grid
from evg_app.grasping.turned import OneSided
from evg_app.grasping.vgn import VgnPlanner
from evg_app.nets.giga import GIGA, sample_planes
from evg_app.nets.vgn import VGN

OFFICIAL = Path(__file__).resolve().parents[3] / "shared" / "checkpoints"
"""Only on the machine where evg-app is developed."""
TOLERANCE = 1e-5
GRID_MIDDLE = 20


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture
def surface() -> np.ndarray:
    """A table with a box on it as the grid of a fixed pattern: values fall from 0.98 to 0.02 through the surface."""
    top = np.full((40, 40), 7)
    top[15:25, 15:25] = 18
    height = np.arange(40)[None, None] + 0.5 - top[..., None]
    values = np.clip(height / 8 + 0.5, 0.0, 1.0)
    return np.where((values > 0.01) & (values < 0.99), values, 0.0).astype(np.float32)


def seeded(kind: type[nn.Module]) -> nn.Module:
    torch.manual_seed(0)
    return kind().eval()


@pytest.mark.parametrize(("kind", "parameters", "tensors"), [(GIGA, 581_863, 164), (VGN, 313_238, 18)])
def test_size_is_that_of_the_official_checkpoint(kind: type[nn.Module], parameters: int, tensors: int) -> None:
    state = kind().state_dict()
    assert (sum(v.numel() for v in state.values()), len(state)) == (parameters, tensors)


def test_tensors_bear_the_official_names() -> None:
    giga, vgn = GIGA().state_dict(), VGN().state_dict()
    assert giga["encoder.unet.up_convs.0.upconv.weight"].shape == (128, 64, 2, 2)
    assert giga["encoder.unet.down_convs.2.conv2.bias"].shape == (128,)
    assert giga["decoder_rot.fc_c.4.weight"].shape == (32, 96)
    assert giga["decoder_tsdf.blocks.3.fc_1.weight"].shape == (32, 32)
    assert vgn["encoder.conv1.weight"].shape == (16, 1, 5, 5, 5)
    assert vgn["decoder.conv3.weight"].shape == (16, 32, 5, 5, 5)


def test_planes_are_means_and_a_point_reads_its_own_pixel() -> None:
    grid = torch.rand(3, 1, 2, 40, 40)
    planes = torch.stack([grid[0], grid[1], grid[2]])
    i, j, k = 7, 21, 33
    p = torch.tensor([[[i, j, k]]]) / 39 - 0.5
    found = sample_planes(planes, p)[0, 0]
    wanted = torch.cat([planes[0, 0, :, k, i], planes[1, 0, :, j, i], planes[2, 0, :, k, j]])
    assert (found - wanted).abs().max() < 1e-2


def test_giga_planes_do_not_mix_up_axes() -> None:
    net = seeded(GIGA)
    grid = torch.zeros(1, 1, 40, 40, 40)
    grid[0, 0, 5, 20, 33] = 1.0
    quiet = net.encode(torch.zeros_like(grid))
    changed = (net.encode(grid) - quiet).abs().sum(dim=(1, 2))
    for plane, (row, column) in zip(changed, ((33, 5), (20, 5), (33, 20)), strict=True):
        peak = np.unravel_index(int(plane.argmax()), plane.shape)
        assert abs(peak[0] - row) <= 3 and abs(peak[1] - column) <= 3


def test_vgn_answers_every_voxel() -> None:
    with torch.inference_mode():
        quality, rotation, width = seeded(VGN)(torch.rand(1, 1, 40, 40, 40))
    assert quality.shape == width.shape == (1, 40, 40, 40)
    assert ((quality > 0) & (quality < 1)).all()
    assert (rotation.norm(dim=1) - 1).abs().max() < TOLERANCE


@pytest.mark.parametrize(("kind", "planner"), [(GIGA, GigaPlanner), (VGN, VgnPlanner)])
def test_checkpoint_round_trip_plans_the_same(
    kind: type[nn.Module], planner: type[GigaPlanner | VgnPlanner], tmp_path: Path, surface: np.ndarray, monkeypatch
) -> None:
    monkeypatch.setattr(published, "WIDTHS", (-9.0, 9.0))
    monkeypatch.setattr(published.select, "__defaults__", (0.0,))
    net = seeded(kind)
    torch.save(net.state_dict(), tmp_path / "net.pt")
    loaded = load_planner(planner.name, tmp_path / "net.pt")
    direct, again = planner(net).plan(surface), loaded.plan(surface)
    assert len(direct) > 0
    assert np.array_equal(direct.T_task_grasp, again.T_task_grasp) and np.array_equal(direct.score, again.score)
    assert len(loaded.weights_sha256) == 64 and isinstance(loaded, OneSided)


@pytest.mark.parametrize("model", ["giga", "vgn"])
def test_weights_are_required_and_must_fit(model: str, tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="no shipped weights"):
        load_planner(model)
    with pytest.raises(WeightsError, match="cannot be read"):
        load_planner(model, tmp_path / "nothing.pt")
    (tmp_path / "noise.pt").write_bytes(b"no checkpoint at all")
    with pytest.raises(WeightsError, match="not a checkpoint"):
        load_planner(model, tmp_path / "noise.pt")
    other = VGN() if model == "giga" else GIGA()
    torch.save(other.state_dict(), tmp_path / "other.pt")
    with pytest.raises(WeightsError, match="not a checkpoint"):
        load_planner(model, tmp_path / "other.pt")


def test_smoothed_quality_of_the_sparse_lattice_is_that_of_the_dense_one(surface: np.ndarray) -> None:
    quality = np.random.default_rng(0).random((40, 40, 40)).astype(np.float32)
    valid = published.valid_mask(surface)
    sparse = np.where(published.with_neighbours(valid), quality, 0.0).astype(np.float32)
    answers = [published.select(q, valid, lambda where: np.full(len(where), 0.1), 0.2) for q in (quality, sparse)]
    assert len(answers[0][0]) > 10
    for dense, thin in zip(*answers, strict=True):
        assert np.array_equal(dense, thin)


def test_masks_keep_bounds_and_width(surface: np.ndarray) -> None:
    valid = published.valid_mask(surface)
    inside = np.argwhere(valid)
    assert inside.min(axis=0).tolist() >= [2, 2, 7] and inside.max(axis=0)[:2].tolist() <= [37, 37]
    quality = np.ones((40, 40, 40), dtype=np.float32)
    thin, wide = (published.select(quality, valid, lambda where, w=w: np.full(len(where), w)) for w in (0.03, 0.24))
    assert len(thin[0]) == len(wide[0]) == 0


def test_grasp_lies_at_its_voxels_lower_corner() -> None:
    index = np.ravel_multi_index((4, 10, GRID_MIDDLE), (40, 40, 40))
    grasps = published.as_grasps(np.array([index]), np.array([[0.0, 0, 0, 1]]), np.array([0.2]), np.array([0.9]))
    assert np.abs(grasps.T_task_grasp[0, :3, 3] - [0.03, 0.075, 0.15]).max() < TOLERANCE
    assert grasps.width[0] == pytest.approx(0.06)


def test_empty_grid_has_no_grasp() -> None:
    empty: Grid = np.zeros((40, 40, 40), dtype=np.float32)
    assert len(GigaPlanner(GIGA()).plan(empty)) == 0
    assert len(VgnPlanner(VGN()).plan(empty)) == 0


@pytest.mark.skipif(not OFFICIAL.is_dir(), reason="the official checkpoints are not on this machine")
@pytest.mark.parametrize("name", ["giga_packed", "giga_pile", "vgn_packed", "vgn_pile"])
def test_official_checkpoint_loads_with_every_key_and_grasps_a_box(name: str, surface: np.ndarray) -> None:
    planner = load_planner(name.split("_")[0], OFFICIAL / f"{name}.pt")
    grasps = planner.plan(surface)
    assert len(grasps) > 0
    assert np.abs(grasps.T_task_grasp[0, :2, 3] - 0.15).max() < 0.08
