"""Simulated D435i depth images, each of another scene, kept in the cache folder. Making them is `rendering`'s work."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evg_app.config.cache import cache_folder
from evg_app.errors import BadInput
from evg_app.geometry import Array
from evg_app.types import Intrinsics

VERSION = 1
"""Of the recipe that makes the images: another number makes another cache folder."""
DEPTH_SCALE = 0.001
"""Metres per unit of the images."""
CAMERA = Intrinsics(848, 480, 426.678, 426.67822, 427.25256, 234.44296)
"""The simulated D435i (`simulation.views.D435I`, which reading must not import: it would load the simulator)."""


@dataclass(frozen=True)
class DepthFrame:
    """One depth image and where its camera stood.

    Attributes:
        depth: raw image, `DEPTH_SCALE` [m] per unit. Shape (480, 848).
        T_cam_task: maps the task frame to the camera's. Shape (4, 4).
    """

    depth: NDArray[np.uint16]
    T_cam_task: Array


def frame_path(number: int) -> Path:
    """Where a frame is kept."""
    return cache_folder() / "latency" / f"frames-{VERSION}" / f"{number:05d}.npz"


def load_frame(number: int) -> DepthFrame:
    """A frame that was kept.

    Raises:
        BadInput: it was not.
    """
    try:
        with np.load(frame_path(number)) as kept:
            return DepthFrame(kept["depth"], kept["T_cam_task"])
    except (OSError, KeyError, ValueError) as error:
        raise BadInput(f"frame {number} is not at {frame_path(number)}; run: evg-app benchmark latency") from error


def load_frames(count: int) -> Iterator[DepthFrame]:
    """Frames 0 to `count` - 1, each read when its turn comes; errors as `load_frame`."""
    return (load_frame(number) for number in range(count))


def keep_frame(number: int, frame: DepthFrame) -> None:
    """Write a frame to the cache folder, whole or not at all.

    Raises:
        BadInput: the cache folder cannot be written.
    """
    path = frame_path(number)
    scratch = path.with_suffix(".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with scratch.open("wb") as file:
            np.savez_compressed(file, depth=frame.depth, T_cam_task=frame.T_cam_task)
        scratch.replace(path)
    except OSError as error:
        raise BadInput(
            f"cannot keep frames in {path.parent}: {error.strerror}; point XDG_CACHE_HOME elsewhere"
        ) from error
