"""Where cameras stand (spec §4.3): the simulated D435i, the fixed side view and three random-view recipes."""

from collections.abc import Callable

import numpy as np

from evg_app.errors import UnknownName
from evg_app.geometry import WORKSPACE_SIZE, Array, camera_on_sphere
from evg_app.types import Intrinsics

D435I = Intrinsics(848, 480, 426.678, 426.67822, 427.25256, 234.44296)
"""Depth stream of a RealSense D435i at 848x480, rectified."""
GIGA_CAMERA = Intrinsics(640, 480, 540.0, 540.0, 320.0, 240.0)
"""The camera of GIGA, IGD and VGN, for comparisons with their weights."""
NEAR, FAR = 0.1, 2.0
"""Range in which the simulated camera measures [m]."""

_CENTER = (WORKSPACE_SIZE / 2, WORKSPACE_SIZE / 2)


def side_view() -> Array:
    """T_task_cam of the fixed side view: at task (0.15, -0.3696, 0.4). Shape (4, 4)."""
    return camera_on_sphere((*_CENTER, 0.10), 0.6, np.deg2rad(60.0), np.deg2rad(-90.0))


def _random_view(
    radius: tuple[float, float], polar: tuple[float, float], azimuth: tuple[float, float], height: float
) -> Callable[[np.random.Generator], Array]:
    def draw(rng: np.random.Generator) -> Array:
        """One camera pose (4, 4)."""
        r = rng.uniform(*radius) * WORKSPACE_SIZE
        theta, phi = np.deg2rad(rng.uniform(*polar)), np.deg2rad(rng.uniform(*azimuth))
        return camera_on_sphere((*_CENTER, height), r, float(theta), float(phi))

    return draw


RANDOM_VIEWS: dict[str, Callable[[np.random.Generator], Array]] = {
    "orbitgrasp": _random_view((1.5, 2.0), (45.0, 75.0), (0.0, 180.0), 0.15),
    "icgnet": _random_view((2.0, 2.5), (45.0, 60.0), (0.0, 180.0), 0.25),
    "igd": _random_view((1.6, 2.4), (45.0, 75.0), (-180.0, -67.5), 0.10),
}
"""Recipes that draw a T_task_cam (4, 4)."""


def draw_view(name: str, rng: np.random.Generator) -> Array:
    """T_task_cam of the view "side" or of a random-view recipe. Shape (4, 4).

    Raises:
        UnknownName: no such view.
    """
    if name == "side":
        return side_view()
    if name not in RANDOM_VIEWS:
        raise UnknownName("camera view", name, ["side", *RANDOM_VIEWS])
    return RANDOM_VIEWS[name](rng)
