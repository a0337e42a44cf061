"""What GIGA's and VGN's planners share: official checkpoints, lattice, masks and selection (spec §5).

Kept as published on purpose: voxel corners as the lattice, an even maximum filter, thresholds of their scripts.
"""

import hashlib
import io
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import nn

from evg_app.errors import WeightsError
from evg_app.geometry import GRID_SIZE, VOXEL_SIZE, Array, from_quaternion, make
from evg_app.grasping.selection import Mask, Volume
from evg_app.types import Grasps

SIDE_AZIMUTH = -np.pi / 2
"""Azimuth of the camera in the official training data [rad]."""
LOW_THRESHOLD = 0.5
"""Least quality of a grasp (LOW_TH of spec §5; with `--force` it alone decides)."""
SURFACE_VALUE = 0.1
"""TSDF value above which a voxel is outside objects (out_th)."""
SIGMA = 1.0
"""Smoothing of the quality [voxels]."""
REACH = 4
"""How far one voxel's quality reaches when smoothed [voxels]: the filter is cut off at 4 sigma."""
BORDER, LOWEST = int(0.02 / VOXEL_SIZE), int(0.055 / VOXEL_SIZE)
"""Voxels without a grasp along the walls, and from the cube's floor up."""
FILTER_SIZE = 4
"""Side of the maximum filter [voxels]."""
WIDTHS = (0.033, 0.233)
"""Predicted openings that are believed, as fraction of the workspace."""

Indices = NDArray[np.intp]


def load_checkpoint(net: nn.Module, path: Path) -> str:
    """Fill a network from an official `.pt` file, every key matched; nothing is unpickled but tensors. Its sha256.

    Raises:
        WeightsError: the file is missing, is not a checkpoint, or does not fit the network.
    """
    name = type(net).__name__
    try:
        data = path.read_bytes()
        state = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
        net.load_state_dict(state)
    except OSError as error:
        raise WeightsError(
            f"weights {path} cannot be read: {error.strerror}; give the official {name} checkpoint with --weights"
        ) from error
    except (RuntimeError, pickle.UnpicklingError, EOFError, ValueError, TypeError, AttributeError) as error:
        first = str(error).strip().splitlines()[:2]
        raise WeightsError(
            f"{path} is not a checkpoint of {name}: {' '.join(first)}; give the official file with --weights"
        ) from error
    net.eval()
    return hashlib.sha256(data).hexdigest()


def valid_mask(values: Volume) -> Mask:
    """Voxels where a grasp may be: near seen surface, and inside the bounds. Shape (40, 40, 40)."""
    outside = values > SURFACE_VALUE
    inside = (values > 1e-3) & (values < SURFACE_VALUE)
    near: Mask = ndimage.binary_dilation(outside, iterations=2, mask=~inside)
    bounds = np.zeros_like(near)
    bounds[BORDER:-BORDER, BORDER:-BORDER, LOWEST:] = True
    return near & bounds


def with_neighbours(mask: Mask) -> Mask:
    """The mask and all voxels whose quality reaches it when smoothed."""
    size = 2 * REACH + 1
    grown: Mask = ndimage.maximum_filter(mask, size=size, mode="constant")
    return grown


def select(
    quality: Volume, valid: Mask, width_at: Callable[[Indices], Array], threshold: float = LOW_THRESHOLD
) -> tuple[Indices, Array, Array]:
    """Smooth, mask, threshold and thin out.

    Args:
        quality: in [0, 1], right wherever it reaches `valid`. Shape (40, 40, 40).
        valid: where grasps may be. Shape (40, 40, 40).
        width_at: opening, as fraction of the workspace, at flat voxel indices.
        threshold: least smoothed quality.

    Returns:
        Flat voxel indices (N,), best first, their quality (N,) and opening as fraction of the workspace (N,).
    """
    smoothed = np.asarray(ndimage.gaussian_filter(quality, sigma=SIGMA, mode="nearest"))
    smoothed[~valid] = 0.0
    smoothed[smoothed < threshold] = 0.0
    asked = np.flatnonzero(smoothed)
    width = width_at(asked)
    smoothed.ravel()[asked[(width < WIDTHS[0]) | (width > WIDTHS[1])]] = 0.0
    peak = (smoothed == ndimage.maximum_filter(smoothed, size=FILTER_SIZE)) & (smoothed > 0)
    index = np.flatnonzero(peak)
    index = index[np.argsort(-smoothed.ravel()[index], kind="stable")]
    return index, smoothed.ravel()[index].astype(np.float64), width[np.searchsorted(asked, index)]


def corners(index: Indices) -> Array:
    """Lower corners of voxels in the cube, 0 to 1 (the official lattice). Flat indices (N,) -> (N, 3)."""
    ijk: Array = np.stack(np.unravel_index(index, (GRID_SIZE,) * 3), axis=-1) / float(GRID_SIZE)
    return ijk


def as_grasps(index: Indices, quaternion: Array, width: Array, quality: Array) -> Grasps:
    """Grasps at voxel corners: quaternions xyzw (N, 4), openings as fraction of the workspace (N,), quality (N,)."""
    if len(index) == 0:
        return Grasps.empty()
    size = GRID_SIZE * VOXEL_SIZE
    R = np.stack([from_quaternion(q)[:3, :3] for q in quaternion])
    return Grasps(make(R, corners(index) * size), width * size, quality)
