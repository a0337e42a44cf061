"""A bad depth image is refused with the reason and the next step."""

import numpy as np
import pytest

from evg_app.errors import Refused
from evg_app.geometry import invert, look_at
from evg_app.perception.health import depth_health
from evg_app.types import Frame, Intrinsics

CAMERA = Intrinsics(848, 480, 426.678, 426.67822, 427.25256, 234.44296)
TOP_VIEW = invert(look_at([0.15, 0.15, 0.65], [0.15, 0.15, 0.0], up=[0, 1, 0]))
AWAY = invert(look_at([0.15, 0.15, 0.65], [0.9, 0.15, 0.65]))


def frame_at(depth_mm=600, valid=1.0):
    """A flat surface `depth_mm` in front of the camera, with the given share of valid pixels."""
    rng = np.random.default_rng(0)
    depth = np.where(rng.random((480, 848)) < valid, depth_mm, 0).astype(np.uint16)
    return Frame(depth, 0.001, CAMERA, 0.0, "cam")


def test_a_table_in_view_is_healthy():
    health = depth_health(frame_at(), TOP_VIEW)
    assert health.ok and health.in_view > 0.9 and health.valid == 1.0 and health.near > 0.1
    health.require()


@pytest.mark.parametrize(
    ("frame", "T_cam_task", "words"),
    [
        (frame_at(), AWAY, "does not see the workspace"),
        (frame_at(valid=0.1), TOP_VIEW, "pixels without depth"),
        (frame_at(1500), TOP_VIEW, "No surface lies in the workspace"),
    ],
)
def test_each_fault_has_its_own_advice(frame, T_cam_task, words):
    health = depth_health(frame, T_cam_task)
    assert not health.ok
    with pytest.raises(Refused, match=words) as caught:
        health.require()
    assert "evg-app doctor" in str(caught.value) and caught.value.exit_code == 3


def test_the_valid_ratio_is_measured_and_its_limit_is_the_configs():
    health = depth_health(frame_at(valid=0.4), TOP_VIEW)
    assert health.valid == pytest.approx(0.4, abs=0.02) and health.ok
    assert not depth_health(frame_at(valid=0.4), TOP_VIEW, min_valid=0.6).ok
