"""The free-flying gripper: what holds, what does not, and where it goes (spec §6.2)."""

from collections.abc import Iterator

import numpy as np
import pybullet
import pytest

from evg_app.geometry import TABLE_HEIGHT, Array, make, rotation_about
from evg_app.simulation.bullet import Client, connect
from evg_app.simulation.free_gripper import FreeGripper, retreat, try_grasp
from evg_app.simulation.scenes import add_table, step

POSITION_TOLERANCE = 1e-6
MARGIN = 0.0045
"""Bullet's margin around hulls, and rounding [m]."""
WIDTH_TOLERANCE = 0.004
HEIGHT_TOLERANCE = 0.005
BOX_HALF = (0.02, 0.015, 0.04)
TOP_DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture
def world() -> Iterator[tuple[Client, int]]:
    """A table with one upright box, 30 mm thick in y, in the middle."""
    client = connect(solver_iterations=150)
    add_table(client, np.eye(4))
    shape = client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=BOX_HALF)
    body = client.createMultiBody(0.2, shape, -1, [0.15, 0.15, TABLE_HEIGHT + BOX_HALF[2]])
    client.changeDynamics(body, -1, lateralFriction=1.0)
    step(client, 30)
    yield client, body
    client.disconnect()


def above(z: float, x: float = 0.15, y: float = 0.15) -> Array:
    return make(TOP_DOWN, [x, y, z])


def test_tips_lie_five_centimetres_before_the_grasp_frame(world: tuple[Client, int]) -> None:
    client, _ = world
    gripper = FreeGripper(client, above(0.29))
    assert np.abs(gripper.T_world_grasp() - above(0.29)).max() < POSITION_TOLERANCE
    low = min(client.getAABB(gripper.body, link)[0][2] for link in (0, 1))
    assert low == pytest.approx(0.29 - 0.05, abs=MARGIN)


def test_box_between_the_fingers_is_lifted(world: tuple[Client, int]) -> None:
    client, box = world
    before = client.getBasePositionAndOrientation(box)[0][2]
    outcome = try_grasp(client, above(0.15), [box])
    assert outcome.success and outcome.held == box and not outcome.touched
    assert outcome.width == pytest.approx(2 * BOX_HALF[1], abs=WIDTH_TOLERANCE)
    assert client.getBasePositionAndOrientation(box)[0][2] - before == pytest.approx(0.10, abs=HEIGHT_TOLERANCE)
    assert client.getNumBodies() == 2


def test_closing_in_the_air_fails(world: tuple[Client, int]) -> None:
    client, box = world
    outcome = try_grasp(client, above(0.25), [box])
    assert not outcome.success and outcome.held is None and not outcome.touched


def test_touch_on_the_approach_stops_it_but_the_fingers_close(world: tuple[Client, int]) -> None:
    client, box = world
    outcome = try_grasp(client, above(0.15, y=0.15 + 0.04), [box])
    assert outcome.touched and not outcome.success
    assert outcome.width < 2 * BOX_HALF[1]


def test_only_objects_can_be_held(world: tuple[Client, int]) -> None:
    client, _ = world
    assert not try_grasp(client, above(0.15), []).success


def test_retreat_is_backwards_when_steep_and_upwards_otherwise() -> None:
    steep = make(rotation_about("x", np.pi - np.deg2rad(59))[:3, :3], [0.1, 0.1, 0.1])
    flat = make(rotation_about("x", np.pi - np.deg2rad(61))[:3, :3], [0.1, 0.1, 0.1])
    assert np.abs(retreat(steep) - (steep[:3, 3] - 0.1 * steep[:3, 2])).max() < POSITION_TOLERANCE
    assert np.abs(retreat(flat) - [0.1, 0.1, 0.2]).max() < POSITION_TOLERANCE
