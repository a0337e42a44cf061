"""The loop on an arm behind ROS 2 actions: the loop here, the arm, the objects and the camera over there.

The robot is reached over ROS 2 only; camera images, new scenes and the truth come beside it, as from a person.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ros2_peer import PeerProcess

from evg_app.clock import Clock
from evg_app.config.files import load_camera, load_robot
from evg_app.config.models import RobotConfig
from evg_app.errors import DeviceTimeout
from evg_app.events import Event, fan_out
from evg_app.geometry import Array
from evg_app.grasping.protocol import Planner
from evg_app.motion.feasibility import MotionPlanner
from evg_app.picking.context import Context, Devices, Settings
from evg_app.picking.motion import PlannedMotion
from evg_app.picking.perceive import TablePerception
from evg_app.picking.run import RunResult, run_rounds
from evg_app.robots.ros2 import Ros2Robot, open_robot
from evg_app.trials.recorder import Recorder
from evg_app.types import Frame, Intrinsics
from evg_app.unconnected import Unconnected

SETTINGS = Settings(motion_slack=40.0)
"""On a busy computer the peer's physics is slower than real time; a robot is not."""


class PeerCamera(Unconnected):
    """The peer's depth camera; stamped with our clock."""

    def __init__(self, peer: PeerProcess, clock: Clock) -> None:
        self._peer, self._clock, self._number = peer, clock, 0
        self._config = load_camera("d435i")
        self.T_base_cam: Array = peer.ask("camera_pose")

    @property
    def intrinsics(self) -> Intrinsics:
        return self._config.simulated_intrinsics()

    @property
    def frame_id(self) -> str:
        return self._config.frame_id

    def capture(self, *, after: float, timeout: float) -> Frame:
        if self._clock.now() < after:
            raise DeviceTimeout("a frame", timeout)
        self._number += 1
        return replace(self._peer.ask("frame"), stamp=self._clock.now(), number=self._number)


class PeerRounds:
    """Sets the peer's table."""

    def __init__(self, peer: PeerProcess, robot: Ros2Robot) -> None:
        self._peer, self._robot = peer, robot

    def prepare(self, round_index: int, seed: int) -> int:
        count = int(self._peer.ask("round", round_index, seed))
        self._robot.arm.recover(5.0)
        return count


class PeerReferee:
    """The peer's truth."""

    def __init__(self, peer: PeerProcess) -> None:
        self._peer = peer

    def on_table(self) -> int:
        return int(self._peer.ask("truth")[0])

    def in_bin(self) -> int:
        return int(self._peer.ask("truth")[1])


def patient(robot: RobotConfig) -> RobotConfig:
    """With waits for a peer that shares its computer with everybody else."""
    assert robot.ros2 is not None
    waits = {"state_timeout_s": 3.0, "feedback_timeout_s": 4.0, "accept_timeout_s": 5.0, "settle_s": 5.0}
    gripper = robot.gripper.model_copy(update={"timeout_s": 60.0})
    return robot.model_copy(update={"ros2": robot.ros2.model_copy(update=waits), "gripper": gripper})


def pick(
    peer: PeerProcess,
    planner: Planner,
    folder: Path,
    seed: int,
    rounds: int,
    listen: Callable[[Event], None] = lambda event: None,
    with_referee: bool = True,
    settings: Settings = SETTINGS,
) -> RunResult:
    """The same loop as `evg-app run`, on the peer."""
    config, camera_config = patient(load_robot("panda")), load_camera("d435i")
    opened = open_robot(config)
    motion = MotionPlanner(config)
    with Recorder(folder, {"peer": "ros2"}) as recorder, opened.arm, opened.gripper:
        camera = PeerCamera(peer, opened.clock)
        perception = TablePerception(
            config.T_base_task.matrix(),
            lambda q: camera.T_base_cam,
            motion.kinematics.link_primitives,
            camera_config.table_is_ruler,
            camera_config.min_valid_ratio,
        )
        context = Context(
            devices=Devices(camera, opened.arm, opened.gripper, opened.clock),
            perception=perception,
            planner=planner,
            motion=PlannedMotion(motion),
            robot=config,
            camera=camera_config,
            sink=fan_out(recorder, listen),
            referee=PeerReferee(peer) if with_referee else None,
            settings=settings,
        )
        return run_rounds(context, PeerRounds(peer, opened), (seed,), rounds)
