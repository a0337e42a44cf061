"""The live world and its devices: determinism, truth, and the contracts of arm, gripper, camera and clock."""

import numpy as np
import pytest

from evg_app.clock import WallClock
from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.config.models import RobotConfig
from evg_app.errors import BadInput, HardwareError
from evg_app.geometry import T_HAND_GRASP, Array, invert, rotation_about, to_quaternion, translation
from evg_app.simulation.arm import GOAL_TOLERANCE, SimulatedArm
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.bullet import TIME_STEP, Client, connect, load_object
from evg_app.simulation.camera import SimulatedCamera, spectate
from evg_app.simulation.gripper import SimulatedGripper
from evg_app.simulation.objects import ObjectModel
from evg_app.simulation.panda import load_robot as load_body
from evg_app.simulation.rendering import SceneCaster
from evg_app.simulation.scenes import PlacedObject
from evg_app.simulation.world import SimClock, SimReferee, SimRounds, SimWorld
from evg_app.types import ArmMode, Trajectory

TRACKING_RAD = 0.01
DEPTH_MEDIAN_M = 0.001
HOLD_SLIP_M = 0.006
WEIGHT_TOLERANCE = 0.1
ROBOT = load_robot("panda")


class Lab:
    """A world with its devices."""

    def __init__(self, scene: str) -> None:
        self.world = SimWorld(ROBOT, load_world(scene), builtin_objects("test"))
        self.arm, self.gripper = SimulatedArm(self.world), SimulatedGripper(self.world)
        self.camera, self.clock = SimulatedCamera(self.world, load_camera("d435i")), SimClock(self.world)

    def go(self, q: Array, duration: float):
        return self.arm.execute(path(self.arm.state().q, q, duration)).wait(duration + 1.0)

    def only(self, model: ObjectModel, x: float, y: float) -> PlacedObject:
        """Leave a single object, standing at (x, y) in the base frame with its narrow side across the hand."""
        for thing in self.world.placed:
            self.world.client.removeBody(thing.body)
        turn = rotation_about("z", np.pi / 2) if model.extents[0] < model.extents[1] else np.eye(4)
        T = translation(x, y, model.extents[2] / 2 + 0.001) @ turn
        thing = PlacedObject(model, load_object(self.world.client, model, 1.0, T, True), 1.0)
        self.world.placed = [thing]
        self.world.step(120)
        return thing


@pytest.fixture
def lab():
    lab = Lab("packed")
    yield lab
    lab.world.close()


def path(q0: Array, q1: Array, duration: float, dt: float = 0.004) -> Trajectory:
    """A smooth straight joint path."""
    n = int(np.ceil(duration / dt))
    s = np.arange(n + 1)[:, None] / n
    total, d = n * dt, (q1 - q0)[None]
    q = q0 + (10 * s**3 - 15 * s**4 + 6 * s**5) * d
    dq = (30 * s**2 - 60 * s**3 + 30 * s**4) / total * d
    ddq = (60 * s - 180 * s**2 + 120 * s**3) / total**2 * d
    return Trajectory(ROBOT.joints, dt, q, dq, ddq)


def joints_for(T_base_hand: Array, robot: RobotConfig = ROBOT) -> Array:
    """Joint position that puts the hand there, found by PyBullet in a client of its own."""
    client: Client = connect()
    try:
        body = load_body(client, robot)
        for joint, q in zip(body.joints, robot.home_q_rad, strict=True):
            client.resetJointState(body.body, joint, q)
        for _ in range(40):
            q = client.calculateInverseKinematics(
                body.body, body.hand, T_base_hand[:3, 3].tolist(), to_quaternion(T_base_hand).tolist()
            )[:7]
            for joint, value in zip(body.joints, q, strict=True):
                client.resetJointState(body.body, joint, value)
        return np.array(q)
    finally:
        client.disconnect()


def in_hand(world: SimWorld, thing: PlacedObject) -> Array:
    """T_hand_object now."""
    return invert(world.T_base_hand()) @ world.T_base_task @ thing.T_task_object(world.client, world.T_base_task)


def above(x: float, y: float, tip_z: float) -> Array:
    """Hand pose with the fingers pointing down, closing along base y, tips at height `tip_z` [m]."""
    T_base_grasp = translation(x, y, tip_z + 0.05) @ rotation_about("x", np.pi)
    return T_base_grasp @ invert(T_HAND_GRASP)


def test_same_seed_reproduces_a_round_exactly():
    runs = []
    for _ in range(2):
        lab = Lab("pile")
        lab.world.new_round(7)
        lab.go(np.array(ROBOT.home_q_rad), 1.0)
        frame = lab.camera.capture(after=lab.clock.now() + 0.1, timeout=1.0)
        runs.append((lab.world.scene(), lab.arm.state().q, frame.depth, lab.world.truth()))
        lab.world.close()
    (scene_a, q_a, depth_a, truth_a), (scene_b, q_b, depth_b, truth_b) = runs
    assert truth_a == truth_b
    for a, b in zip(scene_a.objects, scene_b.objects, strict=True):
        np.testing.assert_array_equal(a.T_task_object, b.T_task_object)
    np.testing.assert_array_equal(q_a, q_b)
    np.testing.assert_array_equal(depth_a, depth_b)


def test_a_round_does_not_depend_on_the_rounds_before_it(lab):
    lab.world.new_round(3)
    lab.go(np.array(ROBOT.home_q_rad), 1.0)
    lab.world.new_round(5)
    later = lab.world.scene()
    fresh = Lab("packed")
    fresh.world.new_round(5)
    for a, b in zip(later.objects, fresh.world.scene().objects, strict=True):
        np.testing.assert_array_equal(a.T_task_object, b.T_task_object)
    np.testing.assert_array_equal(lab.arm.state().q, fresh.arm.state().q)
    fresh.world.close()


def test_rounds_of_a_seed_differ_and_are_counted(lab):
    rounds = SimRounds(lab.world)
    names = []
    for k in range(2):
        count = rounds.prepare(k, 0)
        assert count == SimReferee(lab.world).on_table() >= 1
        names.append(lab.world.truth().on_table)
    assert names[0] != names[1]


def test_clock_sleeps_by_stepping(lab):
    start = lab.clock.now()
    lab.clock.sleep(0.1)
    assert lab.clock.now() - start == pytest.approx(0.1, abs=TIME_STEP)
    lab.clock.sleep(-1.0)
    assert lab.world.steps == 24


def test_trajectory_is_tracked_within_a_hundredth_of_a_radian(lab):
    goal = np.array(ROBOT.drop.q_rad)
    trajectory = path(lab.arm.state().q, goal, 1.5)
    start, handle, worst = lab.clock.now(), lab.arm.execute(trajectory), 0.0
    assert lab.arm.state().mode is ArmMode.MOVING
    while (result := handle.wait(TIME_STEP)) is None:
        times = np.arange(len(trajectory.q)) * trajectory.dt
        wanted = np.array([np.interp(lab.clock.now() - start, times, column) for column in trajectory.q.T])
        worst = max(worst, float(np.abs(lab.arm.state().q - wanted).max()))
    assert worst < TRACKING_RAD
    assert result.reached and result.goal_error < GOAL_TOLERANCE
    assert lab.arm.state().mode is ArmMode.IDLE
    assert lab.clock.now() - start < trajectory.duration + 0.3


def test_arm_holds_its_place_under_gravity(lab):
    before = lab.arm.state().q
    lab.clock.sleep(1.0)
    np.testing.assert_allclose(lab.arm.state().q, before, atol=1e-4)
    np.testing.assert_allclose(lab.arm.state().wrench, 0.0, atol=1e-9)


def test_cancel_brakes_within_the_acceleration_limits_and_can_be_repeated(lab):
    q = lab.arm.state().q
    handle = lab.arm.execute(path(q, q + 0.6, 1.0))
    assert handle.wait(0.5) is None
    handle.cancel()
    handle.cancel()
    speeds = [lab.arm.state().dq]
    while (result := handle.wait(TIME_STEP)) is None:
        speeds.append(lab.arm.state().dq)
    assert not result.reached and result.reason == "cancelled"
    braking = np.abs(np.diff(np.array(speeds), axis=0)) / TIME_STEP
    limits = np.array(ROBOT.limits.acceleration_rad_s2)
    assert (braking.max(axis=0) < 1.25 * limits).all()
    assert np.abs(lab.arm.state().dq).max() < 0.02
    stopped_at = lab.arm.state().q
    assert np.abs(stopped_at - q).max() < 0.5
    lab.clock.sleep(0.5)
    np.testing.assert_allclose(lab.arm.state().q, stopped_at, atol=2e-3)


def test_arm_that_runs_into_the_table_stops_with_a_reflex_and_recovers(lab):
    lab.world.new_round(0)
    for thing in lab.world.placed:
        lab.world.client.removeBody(thing.body)
    lab.world.placed = []
    assert lab.go(joints_for(above(0.5, 0.0, 0.05)), 1.5).reached
    result = lab.go(joints_for(above(0.5, 0.0, -0.15)), 1.0)
    assert not result.reached and "reflex" in result.reason
    state = lab.arm.state()
    assert state.mode is ArmMode.REFLEX and state.errors
    assert state.wrench[2] > 5.0
    with pytest.raises(HardwareError, match="recover"):
        lab.go(np.array(ROBOT.home_q_rad), 1.0)
    lab.arm.recover(2.0)
    assert lab.arm.state().mode is ArmMode.IDLE
    assert lab.go(np.array(ROBOT.home_q_rad), 1.5).reached


def test_gripper_moves_to_a_width_at_its_speed(lab):
    start = lab.clock.now()
    result = lab.gripper.move(0.03, 0.05, 3.0)
    assert result.success and result.width == pytest.approx(0.03, abs=0.001)
    assert 0.8 < lab.clock.now() - start < 1.6
    assert not lab.gripper.state().is_grasped
    assert lab.gripper.homing(3.0).width == pytest.approx(0.08, abs=0.001)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["box", "can", "mug", "egg"])
def test_friction_alone_holds_an_object_while_it_is_lifted_carried_and_dropped(lab, family):
    lab.world.new_round(0)
    model = next(m for m in builtin_objects("test") if m.family == family and sorted(m.extents)[1] < 0.072)
    thing = lab.only(model, 0.5, 0.0)
    tip_z = max(0.008, lab.world.client.getAABB(thing.body)[1][2] - 0.03)
    for height, duration in ((0.12, 1.5), (0.0, 1.0)):
        assert lab.go(joints_for(above(0.5, 0.0, tip_z + height)), duration).reached
    grasp = lab.gripper.grasp(0.0, 0.1, 30.0, 0.08, 0.08, 5.0)
    assert grasp.success and grasp.width > 0.005
    assert lab.gripper.state().is_grasped
    assert lab.go(joints_for(above(0.5, 0.0, tip_z + 0.15)), 1.0).reached
    T_hand_lifted = in_hand(lab.world, thing)
    assert lab.arm.state().wrench[2] == pytest.approx(-9.81 * model.mass, rel=WEIGHT_TOLERANCE)
    assert lab.go(np.array(ROBOT.drop.q_rad), 1.5).reached
    T_hand_carried = in_hand(lab.world, thing)
    assert np.linalg.norm(T_hand_carried[:3, 3] - T_hand_lifted[:3, 3]) < HOLD_SLIP_M
    assert lab.world.truth().in_bin == ()
    assert lab.gripper.move(0.08, 0.1, 3.0).success
    lab.clock.sleep(1.0)
    assert len(lab.world.truth().in_bin) == 1 == SimReferee(lab.world).in_bin()


def test_camera_frame_is_fresh_metric_and_agrees_with_the_scene(lab):
    lab.world.new_round(1)
    after = lab.clock.now() + 0.2
    frame = lab.camera.capture(after=after, timeout=1.0)
    assert frame.stamp >= after and frame.frame_id == lab.camera.frame_id
    assert frame.depth.dtype == np.uint16 and frame.depth.shape == (480, 848)
    assert frame.color is not None and frame.color.shape == (480, 848, 3)
    T_task_cam = invert(lab.world.T_base_task) @ lab.camera.T_base_cam
    cast = SceneCaster(lab.world.scene()).depth(frame.intrinsics, T_task_cam)
    ratio = frame.metres()[200:330, 300:560] / cast[200:330, 300:560]
    assert np.median(np.abs(ratio / np.median(ratio) - 1.0)) < 0.01
    assert abs(np.median(ratio) - 1.0) < 0.15
    second = lab.camera.capture(after=0.0, timeout=1.0)
    assert second.number == frame.number + 1 and second.stamp >= frame.stamp


def test_spectator_sees_the_lab(lab):
    lab.world.new_round(1)
    picture = spectate(lab.world, 160, 120)
    assert picture.shape == (120, 160, 3) and picture.dtype == np.uint8
    assert picture.reshape(-1, 3).std(axis=0).min() > 10


def test_speed_paces_the_world():
    world = SimWorld(ROBOT, load_world("packed"), builtin_objects("test"), speed=4.0)
    wall = WallClock()
    world.step(1)
    start = wall.now()
    world.step(96)
    assert 0.07 < wall.now() - start < 1.0
    world.close()


def test_robot_without_its_hand_is_refused():
    client = connect()
    with pytest.raises(BadInput, match="hand link"):
        load_body(client, ROBOT.model_copy(update={"hand_link": "no_such_link"}))
    client.disconnect()


def test_devices_can_be_left_twice(lab):
    for device in (lab.arm, lab.gripper, lab.camera):
        with device:
            pass
        device.__exit__(None, None, None)
    lab.world.close()
    lab.world.close()
