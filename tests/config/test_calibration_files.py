"""A result is used only while it can be trusted: every reason to refuse one, with the command that mends it."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from evg_app.config.calibration import (
    FORMAT,
    Calibration,
    Errors,
    IntrinsicsModel,
    Witness,
    load_calibration,
    pose_of,
    project,
    save_calibration,
)
from evg_app.config.files import load_camera, load_robot
from evg_app.errors import ConfigError, Refused
from evg_app.geometry import invert, look_at, make, rotation_about, transform_points, translation
from evg_app.types import Intrinsics

NOW = datetime(2026, 6, 1, 12, tzinfo=UTC)
LENS = Intrinsics(848, 480, 427.0, 427.0, 424.0, 240.0, (0.05, -0.02, 1e-4, 1e-4, 0.0))


@pytest.fixture(scope="module")
def robot():
    return load_robot("panda")


@pytest.fixture(scope="module")
def camera():
    return load_camera("d435i")


@pytest.fixture
def make_result(robot, camera):
    """A consistent result; `mode` and other fields can be replaced."""

    def build(mode="eye-to-hand", T_picture_cam=None, **changes):
        T_picture_cam = np.eye(4) if T_picture_cam is None else T_picture_cam
        if mode == "eye-to-hand":
            T_parent_cam = look_at([0.5, -0.6, 0.5], [0.5, 0.0, 0.1])
            T_other_board = translation(-0.1, -0.1, 0.2)
        else:
            T_parent_cam = translation(0.05, 0.02, 0.04) @ rotation_about("z", 0.7) @ rotation_about("x", 0.2)
            T_other_board = translation(0.4, 0.1, 0.0) @ rotation_about("x", np.pi)
        witnesses = []
        for k in range(6):
            hand = make(
                (rotation_about("x", np.pi) @ rotation_about("y", 0.1 * k) @ rotation_about("z", 0.3 * k))[:3, :3],
                np.array([0.45 + 0.02 * k, 0.05 - 0.01 * k, 0.45]),
            )
            point = np.array([0.03 * k, 0.02 * k, 0.0])
            in_base = transform_points(hand @ T_other_board if mode == "eye-to-hand" else T_other_board, point)
            T_base_cam = T_parent_cam if mode == "eye-to-hand" else hand @ T_parent_cam
            p = transform_points(T_picture_cam @ invert(T_base_cam), in_base)
            assert p[2] > 0
            u, v = project(LENS, p)
            witnesses.append(Witness(T_base_hand=pose_of(hand), board_point_m=tuple(point), pixel=(u, v)))
        facts = {
            "format": FORMAT,
            "robot": robot.name,
            "camera": camera.name,
            "mode": mode,
            "parent_frame": robot.hand_link if mode == "eye-in-hand" else "base",
            "camera_frame": camera.frame_id,
            "T_parent_cam": pose_of(T_parent_cam),
            "T_other_board": pose_of(T_other_board),
            "T_picture_cam": pose_of(T_picture_cam),
            "created_utc": NOW - timedelta(days=2),
            "verdict": "go",
            "errors": Errors(
                heldout_mm=0.5,
                heldout_deg=0.1,
                bound_mm=1.0,
                bound_deg=0.1,
                reprojection_px=0.2,
                samples=20,
                rejected=1,
            ),
            "board": "charuco_a4",
            "board_sha256": "0",
            "intrinsics": IntrinsicsModel.of(LENS),
            "witnesses": tuple(witnesses),
        }
        return Calibration(**{**facts, **changes})

    return build


@pytest.fixture
def load(robot, camera, tmp_path):
    """Save results into a folder of their own and load the newest."""

    def act(*results):
        for result in results:
            save_calibration(result, tmp_path / "calibration")
        return load_calibration(robot, camera, tmp_path, NOW)

    return act


@pytest.mark.parametrize("mode", ["eye-to-hand", "eye-in-hand"])
def test_a_good_result_survives_the_file(mode, make_result, load):
    before = make_result(mode)
    after = load(before)
    assert after == before
    assert after.witness_error() < 1e-3


def test_eye_in_hand_follows_the_hand(make_result):
    result, hand = make_result("eye-in-hand"), translation(0.1, 0.2, 0.3)
    assert np.allclose(result.T_base_cam(hand), hand @ result.T_parent_cam.matrix())


def test_pictures_of_the_colour_camera_are_known_by_their_own_frame(make_result, load):
    result = make_result(T_picture_cam=translation(0.015, 0.0, 0.0) @ rotation_about("y", 0.01))
    assert load(result).witness_error() < 1e-3


def test_a_missing_result_names_the_command(load):
    with pytest.raises(Refused, match="evg-app calibrate --robot panda --camera d435i"):
        load()


def test_the_newest_counts(make_result, load):
    old = make_result(created_utc=NOW - timedelta(days=20))
    new = make_result(created_utc=NOW - timedelta(days=1))
    assert load(new, old).created_utc == new.created_utc


def test_a_refused_result_is_refused_with_its_reasons(make_result, load):
    with pytest.raises(Refused, match=r"one axis.*Run: evg-app calibrate"):
        load(make_result(verdict="refuse", reasons=("all rotations are about one axis",)))


def test_a_forced_result_passes_and_says_so(make_result, load):
    assert load(make_result(verdict="refuse", forced=True)).forced


@pytest.mark.parametrize("mode", ["eye-to-hand", "eye-in-hand"])
def test_an_inverted_result_is_named(mode, make_result, load):
    good = make_result(mode)
    with pytest.raises(Refused, match="inverted"):
        load(good.model_copy(update={"T_parent_cam": pose_of(invert(good.T_parent_cam.matrix()))}))


def test_an_edited_result_is_named(make_result, load):
    good = make_result()
    T = good.T_parent_cam.matrix() @ translation(0.02, 0.0, 0.0)
    with pytest.raises(Refused, match="edited"):
        load(good.model_copy(update={"T_parent_cam": pose_of(T)}))


def test_a_stale_result_is_refused(make_result, load, camera):
    age = camera.calibration_max_age_days + 1
    with pytest.raises(Refused, match="31 days old"):
        load(make_result(created_utc=NOW - timedelta(days=age)))


def test_a_result_of_another_camera_frame_is_refused(make_result, load):
    with pytest.raises(Refused, match="camera frame"):
        load(make_result(camera_frame="camera_color_optical_frame"))


def test_a_broken_file_is_named_with_its_line(make_result, load, tmp_path):
    load(make_result())
    path = next((tmp_path / "calibration").glob("*.yaml"))
    path.write_text(path.read_text().replace("mode: eye-to-hand", "mode: sideways"))
    with pytest.raises(ConfigError, match=r"\.yaml:\d+: mode"):
        load()
