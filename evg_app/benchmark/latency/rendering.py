"""Makes the depth images: settled scenes of test objects, from four kinds of views, with noise."""

from collections.abc import Callable

import numpy as np

from evg_app.benchmark.latency.frames import CAMERA, DEPTH_SCALE, VERSION, DepthFrame, frame_path, keep_frame
from evg_app.geometry import invert
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.noise import add_noise
from evg_app.simulation.recipes import SceneRecipe
from evg_app.simulation.rendering import SceneCaster
from evg_app.simulation.scenes import generate_scene_state
from evg_app.simulation.views import draw_view

KINDS = ("packed", "pile")
VIEWS = (("side", "gamma"), ("icgnet", "gaussian"), ("orbitgrasp", "gamma"), ("igd", "gaussian"))
"""Views and their depth noise; frame n takes kind n % 2 and view n // 2 % 4."""


def make_frame(number: int) -> DepthFrame:
    """The frame of that number, a pure function of it."""
    view, noise = VIEWS[number // len(KINDS) % len(VIEWS)]
    state = generate_scene_state(SceneRecipe(KINDS[number % len(KINDS)]), builtin_objects("test"), number)
    rng = np.random.default_rng([number, VERSION])
    T_task_cam = draw_view(view, rng)
    noisy = add_noise(noise, SceneCaster(state).depth(CAMERA, T_task_cam), rng)
    raw = np.clip(np.rint(noisy / DEPTH_SCALE), 0, np.iinfo(np.uint16).max).astype(np.uint16)
    return DepthFrame(raw, invert(T_task_cam))


def make_frames(count: int, progress: Callable[[int, int], None]) -> None:
    """See to it that frames 0 to `count` - 1 are in the cache folder; `progress` hears (made, wanted).

    Raises:
        BadInput: the cache folder cannot be written.
    """
    missing = [number for number in range(count) if not frame_path(number).is_file()]
    for done, number in enumerate(missing, 1):
        keep_frame(number, make_frame(number))
        progress(done, len(missing))
