"""The real lab: camera, arm and gripper of `evg-app run --robot NAME --camera NAME`, behind the guard of `--step`,
the tool box and the protective stop."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from evg_app.cameras.protocol import Camera
from evg_app.cli.hardware_arguments import REPLAY
from evg_app.clock import Clock, WallClock
from evg_app.config.calibration import Calibration
from evg_app.config.models import CameraConfig, RobotConfig
from evg_app.events import DevicesConnected, Sink, Warned
from evg_app.geometry import T_GRASP_TCP, Array
from evg_app.identity import identity_of
from evg_app.motion.kinematics import Kinematics, hand_to_grasp
from evg_app.robots.fci.arm import FciArm
from evg_app.robots.guard import Ask, GuardedArm
from evg_app.robots.protocol import Arm, Gripper

LOSS_WORTH_SAYING = 0.02
"""From this share of lost states on, a warning is due."""

Watch = Callable[[Callable[[], None]], AbstractContextManager[None]]
"""While inside, something outside may call the given function to stop the run."""


@dataclass(frozen=True)
class RealLab:
    """The devices of one run, not yet entered.

    Attributes:
        arm: behind the guard.
        T_base_cam: the camera's pose for joint positions [rad]. Shape (7,) -> (4, 4).
        stop_topic: listens for a stop on the network.
        after: says what the connection was like, at the end of a run.
    """

    robot: RobotConfig
    camera_config: CameraConfig
    camera: Camera
    arm: GuardedArm
    gripper: Gripper
    clock: Clock
    T_base_cam: Callable[[Array], Array]
    stop_topic: Watch
    after: Callable[[], str]


@dataclass(frozen=True)
class Wishes:
    """What the person asked for.

    Attributes:
        driver: "ros2" or "fci".
        camera: its name, or `replay/` and stored frames.
        host: the arm's address over the FCI, empty takes the config's.
        serial: which of several cameras.
        step: ask before each motion.
        dry: send nothing.
    """

    driver: str
    camera: str
    host: str = ""
    serial: str = ""
    step: bool = False
    dry: bool = False


def build_real_lab(
    robot: RobotConfig,
    camera: CameraConfig,
    calibration: Calibration,
    wishes: Wishes,
    kinematics: Kinematics,
    ask: Ask,
    sink: Sink,
) -> RealLab:
    """The devices of a run; nothing is opened yet.

    Raises:
        BadInput: stored frames that are none, or a robot without the driver's section.
    """
    arm, gripper, clock, watch, after = _robot(robot, wishes, kinematics, WallClock())
    guard = _guarded(arm, robot, wishes, kinematics, ask)
    return RealLab(
        robot,
        camera,
        _camera(wishes, camera, clock, sink),
        guard,
        gripper,
        clock,
        lambda q: calibration.T_base_cam(kinematics.fk_hand(q)),
        watch,
        after,
    )


def guarded_arm(
    robot: RobotConfig, wishes: Wishes, kinematics: Kinematics, ask: Ask, clock: Clock
) -> tuple[GuardedArm, Clock]:
    """The arm alone, behind the limits that a person set, and the clock of its stamps; nothing is opened yet.

    Raises:
        BadInput: a robot without the driver's section.
    """
    arm, _, clock, _, _ = _robot(robot, wishes, kinematics, clock)
    return _guarded(arm, robot, wishes, kinematics, ask), clock


def _guarded(arm: Arm, robot: RobotConfig, wishes: Wishes, kinematics: Kinematics, ask: Ask) -> GuardedArm:
    """The arm behind the limits that a person set."""
    return GuardedArm(
        arm,
        lambda q: tool_of(robot, kinematics, q)[:, :3, 3],
        robot.tool_box,
        acknowledge=ask,
        step=ask if wishes.step else None,
        dry=wishes.dry,
    )


def tool_of(robot: RobotConfig, kinematics: Kinematics, q: Array) -> Array:
    """T_base_tcp for joint positions (7,) or (N, 7) [rad]. Shape (4, 4) or (N, 4, 4)."""
    T: Array = kinematics.fk_hand(q) @ hand_to_grasp(robot) @ T_GRASP_TCP
    return T


def _robot(
    robot: RobotConfig, wishes: Wishes, kinematics: Kinematics, clock: Clock
) -> tuple[Arm, Gripper, Clock, Watch, Callable[[], str]]:
    """Arm, gripper, clock, stop topic and closing report of the wished driver."""
    if wishes.driver == "fci":
        from evg_app.robots.fci.gripper import FciGripper

        if wishes.host:
            robot = robot.model_copy(update={"fci": robot.fci.model_copy(update={"host": wishes.host})})
        arm = FciArm(robot, lambda q: tool_of(robot, kinematics, q))
        return arm, FciGripper(robot), clock, lambda stop: nullcontext(), lambda: link_report(arm)
    from evg_app.robots.ros2.open import open_robot

    over_ros = open_robot(robot, clock)
    return over_ros.arm, over_ros.gripper, over_ros.clock, over_ros.listening_for_stop, lambda: ""


@contextmanager
def open_arm(robot: RobotConfig, wishes: Wishes, kinematics: Kinematics) -> Iterator[Arm]:
    """The arm alone, entered; for verbs that only read it."""
    arm, *_ = _robot(robot, wishes, kinematics, WallClock())
    with arm:
        yield arm


def _camera(wishes: Wishes, config: CameraConfig, clock: Clock, sink: Sink) -> Camera:
    """The camera, or stored frames."""
    from evg_app.cameras.factory import open_camera, open_replay

    if wishes.camera.startswith(REPLAY):
        return open_replay(config, Path(wishes.camera.removeprefix(REPLAY)), clock=clock, repeat=True)
    return open_camera(config, clock=clock, sink=sink, serial=wishes.serial)


def link_report(arm: FciArm) -> str:
    """How many states of the arm were lost since connecting."""
    received, lost, longest = arm.link_quality()
    share = lost / max(received + lost, 1)
    text = f"link to the arm: {lost}/{received + lost} states lost = {share:.2%}, at most {longest} in a row"
    return text + (". See docs/franka.md on the kernel and the network" if share > LOSS_WORTH_SAYING else "")


@contextmanager
def entered(lab: RealLab, sink: Sink) -> Iterator[RealLab]:
    """All devices entered; what they are and warnings of the connection go to the sink."""
    with lab.camera, lab.arm, lab.gripper:
        named = {"camera": lab.camera, "arm": lab.arm, "gripper": lab.gripper}
        sink(DevicesConnected({name: identity_of(device) for name, device in named.items()}))
        for text in getattr(lab.arm.inner, "warnings", ()):
            sink(Warned("robot connection", text))
        yield lab
