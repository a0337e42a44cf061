"""ONE suite that every camera, arm and gripper must pass.

A new robot driver adds its bench to `BENCHES`, a new camera driver to `CAMERA_BENCHES`, nothing else.
"""

import atexit
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "cameras"))
sys.path.insert(0, str(Path(__file__).parent.parent / "robots" / "ros2" / "peer"))
sys.path.insert(0, str(Path(__file__).parent.parent / "robots" / "fci"))

from recordings import table_depth, write_recording

from evg_app.cameras.factory import open_replay
from evg_app.cameras.protocol import Camera
from evg_app.cameras.realsense.camera import RealSenseCamera
from evg_app.cameras.realsense.start import Recording
from evg_app.clock import Clock, WallClock
from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.errors import DeviceTimeout, HardwareError, Refused
from evg_app.identity import identity_of
from evg_app.robots.protocol import Arm, Gripper, MotionHandle
from evg_app.simulation.arm import SimulatedArm
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.camera import SimulatedCamera
from evg_app.simulation.gripper import SimulatedGripper
from evg_app.simulation.world import SimClock, SimWorld
from evg_app.types import ArmMode, MotionResult, Trajectory

GOAL_RAD = 0.02
WIDTH_M = 0.002
TURN = np.array([0.15, -0.1, 0.1, 0.1, 0.1, -0.1, 0.2])
"""A small free motion from where a bench starts [rad]."""


@dataclass(frozen=True)
class Bench:
    """Arm and gripper of one driver family, not yet entered."""

    arm: Arm
    gripper: Gripper
    clock: Clock
    close: Callable[[], None]


@dataclass(frozen=True)
class CameraBench:
    """A camera and its clock, not yet entered."""

    camera: Camera
    clock: Clock
    close: Callable[[], None]


def simulated() -> Bench:
    world = SimWorld(load_robot("panda"), load_world("packed"), builtin_objects("test"))
    return Bench(SimulatedArm(world), SimulatedGripper(world), SimClock(world), world.close)


def simulated_camera() -> CameraBench:
    world = SimWorld(load_robot("panda"), load_world("packed"), builtin_objects("test"))
    return CameraBench(SimulatedCamera(world, load_camera("d435i")), SimClock(world), world.close)


@cache
def recording() -> Path:
    """A .db3 file of a table, written by a software device."""
    path = Path(tempfile.mkdtemp()) / "table.db3"
    atexit.register(shutil.rmtree, path.parent, ignore_errors=True)
    return write_recording(path, [np.rint(table_depth()).astype(np.uint16)] * 12)


def realsense_camera() -> CameraBench:
    """librealsense's own pipeline on a recording, as fast as it was taken."""
    clock = WallClock()
    source = Recording(recording(), repeat=True)
    return CameraBench(RealSenseCamera(load_camera("d435i"), clock, recording=source), clock, lambda: None)


def replay_camera() -> CameraBench:
    clock = WallClock()
    return CameraBench(open_replay(load_camera("d435i"), recording(), clock=clock, repeat=True), clock, lambda: None)


def ros2() -> Bench:
    from ros2_peer import shared_peer

    from evg_app.robots.ros2 import open_robot

    shared_peer().ask("home")
    opened = open_robot(load_robot("panda"))
    return Bench(opened.arm, opened.gripper, opened.clock, lambda: None)


@cache
def peer_of_fci():
    """The strict speaker of the Franka protocol in another process, with nothing between its fingers."""
    from fci_peers import franka_sim

    peer = franka_sim(object_width=None)
    atexit.register(peer.close)
    return peer


def fci() -> Bench:
    from fci_peers import robot_at, tool_pose_of

    from evg_app.robots.fci.arm import FciArm
    from evg_app.robots.fci.gripper import FciGripper

    robot = robot_at(peer_of_fci().host)
    return Bench(FciArm(robot, tool_pose_of(robot)), FciGripper(robot), WallClock(), lambda: None)


BENCHES: dict[str, Callable[[], Bench]] = {"simulated": simulated, "ros2": ros2, "fci": fci}
CAMERA_BENCHES: dict[str, Callable[[], CameraBench]] = {
    "simulated": simulated_camera,
    "realsense": realsense_camera,
    "replay": replay_camera,
}


NEEDS = {"ros2": pytest.mark.ros, "fci": pytest.mark.slow}
"""Benches that run in an environment of their own, or take long."""
ROBOTS = [pytest.param(name, marks=NEEDS.get(name, ())) for name in sorted(BENCHES)]


@pytest.fixture(params=ROBOTS)
def bench(request) -> Iterator[Bench]:
    made = BENCHES[request.param]()
    with ExitStack() as stack:
        stack.callback(made.close)
        for device in (made.arm, made.gripper):
            stack.enter_context(device)
        yield made


@pytest.fixture(params=sorted(CAMERA_BENCHES))
def view(request) -> Iterator[CameraBench]:
    made = CAMERA_BENCHES[request.param]()
    with ExitStack() as stack:
        stack.callback(made.close)
        stack.enter_context(made.camera)
        yield made


def motion(arm: Arm, turn: np.ndarray, duration: float = 1.0, dt: float = 0.004) -> Trajectory:
    """A smooth motion from where the arm is."""
    n = round(duration / dt)
    s = np.arange(n + 1)[:, None] / n
    q = arm.state().q + (10 * s**3 - 15 * s**4 + 6 * s**5) * turn
    dq = (30 * s**2 - 60 * s**3 + 30 * s**4) / duration * turn
    return Trajectory(arm.joint_names, dt, q, dq, (60 * s - 180 * s**2 + 120 * s**3) / duration**2 * turn)


def end_of(handle: MotionHandle, slices: int = 400) -> MotionResult:
    """Wait in slices, as the loop does."""
    for _ in range(slices):
        result = handle.wait(0.02)
        if result is not None:
            return result
    raise AssertionError("the motion never ended")


def test_state_has_a_fresh_stamp_and_no_errors(bench: Bench):
    first = bench.arm.state()
    bench.clock.sleep(0.1)
    second = bench.arm.state()
    assert second.stamp > first.stamp
    assert first.q.shape == first.dq.shape == (len(bench.arm.joint_names),)
    assert first.wrench.shape == (6,)
    assert first.mode is ArmMode.IDLE and first.errors == ()


def test_devices_say_what_they_are(bench: Bench):
    for device in (bench.arm, bench.gripper):
        told = identity_of(device)
        assert told["driver"] and all(isinstance(value, str) for value in told.values())


def test_trajectory_is_followed_to_its_goal(bench: Bench):
    trajectory = motion(bench.arm, TURN)
    handle = bench.arm.execute(trajectory)
    assert handle.wait(0.05) is None
    assert bench.arm.state().mode is ArmMode.MOVING
    result = end_of(handle)
    assert result.reached and result.goal_error < GOAL_RAD
    assert np.abs(bench.arm.state().q - trajectory.q[-1]).max() < GOAL_RAD


def test_result_stays_the_same_after_the_end(bench: Bench):
    handle = bench.arm.execute(motion(bench.arm, 0.3 * TURN, 0.5))
    result = end_of(handle)
    handle.cancel()
    assert handle.wait(0.02) == result


def test_cancel_stops_the_arm_short_of_the_goal_and_can_be_repeated(bench: Bench):
    trajectory = motion(bench.arm, 3 * TURN, 2.0)
    handle = bench.arm.execute(trajectory)
    assert handle.wait(0.6) is None
    handle.cancel()
    handle.cancel()
    assert not end_of(handle).reached
    rest = bench.arm.state()
    bench.clock.sleep(0.3)
    assert np.abs(bench.arm.state().q - rest.q).max() < 1e-3
    assert np.abs(rest.q - trajectory.q[-1]).max() > 0.05


def test_arm_can_be_used_again_after_a_cancelled_motion(bench: Bench):
    handle = bench.arm.execute(motion(bench.arm, TURN))
    handle.wait(0.3)
    handle.cancel()
    end_of(handle)
    assert end_of(bench.arm.execute(motion(bench.arm, 0.5 * TURN))).reached


def test_trajectory_that_starts_elsewhere_is_refused_and_nothing_moves(bench: Bench):
    here = motion(bench.arm, TURN)
    before = bench.arm.state().q
    with pytest.raises(Refused):
        bench.arm.execute(Trajectory(here.joint_names, here.dt, here.q + 0.1, here.dq, here.ddq))
    bench.clock.sleep(0.2)
    assert np.abs(bench.arm.state().q - before).max() < 1e-3


def test_trajectory_of_other_joints_is_refused(bench: Bench):
    here = motion(bench.arm, TURN)
    names = tuple(f"other_{i}" for i in range(len(here.joint_names)))
    with pytest.raises(Refused, match="joints"):
        bench.arm.execute(Trajectory(names, here.dt, here.q, here.dq, here.ddq))


def test_second_motion_is_rejected_while_the_first_moves(bench: Bench):
    bench.arm.execute(motion(bench.arm, TURN)).wait(0.2)
    with pytest.raises(HardwareError):
        bench.arm.execute(motion(bench.arm, TURN))


def test_recover_of_a_healthy_arm_returns(bench: Bench):
    bench.arm.recover(timeout=2.0)
    assert bench.arm.state().mode is ArmMode.IDLE


def test_gripper_goes_to_a_width_and_says_so(bench: Bench):
    result = bench.gripper.move(0.03, 0.1, timeout=5.0)
    assert result.success
    assert result.width == pytest.approx(0.03, abs=WIDTH_M)
    assert bench.gripper.state().width == pytest.approx(0.03, abs=WIDTH_M)
    assert not bench.gripper.state().is_grasped


def test_closing_on_nothing_is_judged_by_the_window(bench: Bench):
    missed = bench.gripper.grasp(0.04, 0.1, 30.0, 0.01, 0.01, timeout=5.0)
    assert not missed.success
    assert missed.width < WIDTH_M
    bench.gripper.homing(timeout=10.0)
    assert bench.gripper.grasp(0.0, 0.1, 30.0, 0.08, 0.08, timeout=5.0).success


def test_gripper_stop_keeps_the_fingers_where_they_are(bench: Bench):
    bench.gripper.move(0.05, 0.1, timeout=5.0)
    bench.gripper.stop()
    width = bench.gripper.state().width
    bench.clock.sleep(0.3)
    assert bench.gripper.state().width == pytest.approx(width, abs=WIDTH_M)


def test_frame_is_fresh_metric_and_complete(view: CameraBench):
    after = view.clock.now() + 0.1
    frame = view.camera.capture(after=after, timeout=5.0)
    K = view.camera.intrinsics
    assert frame.stamp >= after
    assert frame.frame_id == view.camera.frame_id
    assert frame.intrinsics == K
    assert frame.depth.dtype == np.uint16 and frame.depth.shape == (K.height, K.width)
    assert 0.0 < np.median(frame.metres()[frame.depth > 0]) < 5.0
    if frame.color is not None:
        assert frame.color.dtype == np.uint8 and frame.color.shape == (K.height, K.width, 3)


def test_camera_says_what_it_is(view: CameraBench):
    assert identity_of(view.camera)["driver"]


def test_frames_are_counted(view: CameraBench):
    first = view.camera.capture(after=0.0, timeout=5.0)
    second = view.camera.capture(after=first.stamp + 0.05, timeout=5.0)
    assert second.number > first.number
    assert second.stamp > first.stamp


def test_camera_does_not_wait_for_ever(view: CameraBench):
    with pytest.raises(DeviceTimeout, match="frame"):
        view.camera.capture(after=view.clock.now() + 60.0, timeout=0.5)


def test_leaving_a_camera_twice_is_harmless(view: CameraBench):
    view.camera.__exit__(None, None, None)
    view.camera.__exit__(None, None, None)


@pytest.mark.parametrize("name", sorted(CAMERA_BENCHES))
def test_leaving_a_camera_that_was_never_entered_is_harmless(name: str):
    made = CAMERA_BENCHES[name]()
    made.camera.__exit__(None, None, None)
    made.close()


def test_leaving_twice_is_harmless(bench: Bench):
    for device in (bench.arm, bench.gripper):
        device.__exit__(None, None, None)
        device.__exit__(None, None, None)


@pytest.mark.parametrize("name", ROBOTS)
def test_leaving_a_device_that_was_never_entered_is_harmless(name: str):
    made = BENCHES[name]()
    for device in (made.arm, made.gripper):
        device.__exit__(None, None, None)
    made.close()
