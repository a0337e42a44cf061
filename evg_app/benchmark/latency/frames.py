"""Simulated D435i depth images to time with: each of another scene, made from its number, kept in the cache folder."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evg_app.config.files import cache_folder
from evg_app.errors import BadInput
from evg_app.geometry import Array, invert
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.noise import add_noise
from evg_app.simulation.recipes import SceneRecipe
from evg_app.simulation.rendering import SceneCaster
from evg_app.simulation.scenes import generate_scene_state
from evg_app.simulation.views import D435I, draw_view

DEPTH_SCALE = 0.001
"""Metres per unit of the images."""
KINDS = ("packed", "pile")
VIEWS = (("side", "gamma"), ("icgnet", "gaussian"), ("orbitgrasp", "gamma"), ("igd", "gaussian"))
"""Views and their depth noise; frame n takes kind n % 2 and view n // 2 % 4."""
VERSION = 1
"""Of the recipe above: another number makes another cache folder."""


@dataclass(frozen=True)
class DepthFrame:
    """One depth image and where its camera stood.

    Attributes:
        depth: raw image, `DEPTH_SCALE` [m] per unit. Shape (480, 848).
        T_cam_task: maps the task frame to the camera's. Shape (4, 4).
    """

    depth: NDArray[np.uint16]
    T_cam_task: Array


def make_frame(number: int) -> DepthFrame:
    """The frame of that number, a pure function of it: a settled scene of test objects, rendered with noise."""
    view, noise = VIEWS[number // len(KINDS) % len(VIEWS)]
    kind = KINDS[number % len(KINDS)]
    state = generate_scene_state(SceneRecipe(kind), builtin_objects("test"), number)
    rng = np.random.default_rng([number, VERSION])
    T_task_cam = draw_view(view, rng)
    noisy = add_noise(noise, SceneCaster(state).depth(D435I, T_task_cam), rng)
    raw = np.clip(np.rint(noisy / DEPTH_SCALE), 0, np.iinfo(np.uint16).max).astype(np.uint16)
    return DepthFrame(raw, invert(T_task_cam))


def frames(count: int) -> Iterator[DepthFrame]:
    """Frames 0 to `count` - 1, each read from the cache folder when its turn comes, made where it is not there.

    Raises:
        BadInput: the cache folder cannot be written.
    """
    folder = cache_folder() / "latency" / f"frames-{VERSION}"
    for number in range(count):
        yield _frame(folder / f"{number:05d}.npz", number)


def _frame(path: Path, number: int) -> DepthFrame:
    """The frame kept at a path, or made and kept now."""
    if path.is_file():
        with np.load(path) as kept:
            return DepthFrame(kept["depth"], kept["T_cam_task"])
    frame = make_frame(number)
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
    return frame
