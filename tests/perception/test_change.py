"""Change near a place between two depth images: seen when an object moved, not from noise, not from the arm."""

import dataclasses

import numpy as np
import pytest

from evg_app.errors import BadInput
from evg_app.geometry import camera_on_sphere, invert, translation
from evg_app.perception.change import scene_change
from evg_app.simulation.noise import GAUSSIAN_SIGMA, add_noise
from evg_app.simulation.rendering import SceneCaster
from evg_app.simulation.state import SceneState
from evg_app.types import Frame, Intrinsics

CAMERA = Intrinsics(424, 240, 213.0, 213.0, 213.0, 117.0)
T_TASK_CAM = camera_on_sphere((0.15, 0.15, 0.10), 0.6, np.deg2rad(60.0), np.deg2rad(-90.0))
T_CAM_TASK = invert(T_TASK_CAM)
PLACE, RADIUS, STEP = np.array([0.15, 0.15, 0.09]), 0.12, 0.02
AREA = 4e-4
"""The shipped threshold [m^2]."""
CUBE = 0.05
NOISY_PAIRS = 40
AREA_SHARE = 0.6
"""At least this share of a removed cube's face must be noticed: blocks lose its rim."""


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    """A scene with one cube at x, y [m], standing on the table."""
    import trimesh

    from evg_app.simulation.state import SceneObject

    path = tmp_path_factory.mktemp("cube") / "cube.obj"
    trimesh.creation.box((CUBE, CUBE, CUBE)).export(path)

    def scene(*places: tuple[float, float]) -> SceneState:
        things = (
            SceneObject("cube", path, path, path, 1.0, translation(x, y, 0.05 + CUBE / 2), True) for x, y in places
        )
        return SceneState(tuple(things))

    return scene


def frame(scene: SceneState, seed: int | None = None, model: str = "gaussian") -> Frame:
    depth = SceneCaster(scene).depth(CAMERA, T_TASK_CAM)
    if seed is not None:
        depth = add_noise(model, depth, np.random.default_rng(seed))
    return Frame(np.rint(depth * 1e4).astype(np.uint16), 1e-4, CAMERA, 0.0, "cam")


def change(before: Frame, after: Frame):
    return scene_change(before, after, T_CAM_TASK, PLACE, RADIUS, STEP)


@pytest.mark.parametrize("shift", [0.02, 0.03, 0.06])
def test_an_object_that_moved_near_the_grasp_is_noticed(cube, shift):
    moved = change(frame(cube((0.15, 0.15)), 0), frame(cube((0.15 + shift, 0.15)), 1))
    assert moved.area > AREA and moved.compared == 1.0


def test_an_object_that_went_or_came_changes_about_its_face(cube):
    with_it, without = frame(cube((0.15, 0.15))), frame(cube((0.15, 0.28)))
    for before, after in ((with_it, without), (without, with_it)):
        assert change(before, after).area > AREA_SHARE * CUBE**2


def test_nothing_happens_where_nothing_moved(cube):
    scene = frame(cube((0.15, 0.15)))
    assert change(scene, scene).area == 0.0


@pytest.mark.parametrize("model", ["gaussian", "gamma"])
def test_noise_alone_stays_below_the_threshold(cube, model):
    """The gamma model's global factor is the table ruler's affair; its smooth field remains here."""
    scene = cube((0.15, 0.15), (0.10, 0.20))
    clean = frame(scene).metres()
    worst = 0.0
    for seed in range(NOISY_PAIRS):
        pair = []
        for k in (0, 1):
            noisy = frame(scene, 2 * seed + k, model)
            ratio = np.median(clean[clean > 0] / np.maximum(noisy.metres()[clean > 0], 1e-3))
            pair.append(dataclasses.replace(noisy, depth_scale=noisy.depth_scale * float(ratio)))
        worst = max(worst, change(*pair).area)
    assert worst < AREA, f"{worst * 1e4:.2f} cm^2 (sigma of the gaussian model {GAUSSIAN_SIGMA} m)"


def test_a_change_far_from_the_grasp_does_not_matter(cube):
    far = change(frame(cube((0.15, 0.15), (0.28, 0.28))), frame(cube((0.15, 0.15), (0.02, 0.28))))
    assert far.area == 0.0


def test_what_the_arm_hides_is_not_compared(cube):
    before, after = frame(cube((0.15, 0.15))), frame(cube((0.15, 0.28)))
    hidden = after.depth.copy()
    hidden[:, :] = 0
    seen = change(before, dataclasses.replace(after, depth=hidden))
    assert (seen.area, seen.compared) == (0.0, 0.0)


def test_images_of_different_size_are_refused(cube):
    whole = frame(cube((0.15, 0.15)))
    with pytest.raises(BadInput, match="cannot be compared"):
        change(whole, dataclasses.replace(whole, depth=whole.depth[::2]))
