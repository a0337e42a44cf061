"""A lab without physics: devices that keep time and state, a table with a script, and places to hurt them."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from evg_app.config.models import CameraConfig, RobotConfig
from evg_app.errors import DeviceTimeout, HardwareError
from evg_app.events import AttemptFinished, MotionStarted, RoundFinished, StateEntered, Warned
from evg_app.geometry import translation
from evg_app.perception.change import SceneChange
from evg_app.picking.context import Context, Decision, Devices, ReadyPick, Settings, View
from evg_app.picking.run import run_rounds
from evg_app.picking.stop import StopToken
from evg_app.types import (
    ArmMode,
    ArmState,
    CollisionVolume,
    Frame,
    Grasps,
    GripperResult,
    GripperState,
    Intrinsics,
    MotionResult,
    Trajectory,
    TsdfGrid,
    Verdict,
)

JOINTS = tuple(f"j{i}" for i in range(7))
LOOK, PREGRASP, GRASP, LIFTED, DROP = 0.0, 1.0, 1.2, 0.8, -1.0
"""Every joint's position at each pose [rad]."""
MOTION_S = 0.2
"""Duration of every motion [s]."""
OBJECT_WIDTH = 0.03
"""Opening when an object is held [m]."""
MAX_WIDTH = 0.08


def pose(value: float) -> np.ndarray:
    return np.full(7, value)


def line(start: float | np.ndarray, goal: float | np.ndarray) -> Trajectory:
    a, b = np.broadcast_to(start, 7), np.broadcast_to(goal, 7)
    q = np.linspace(a, b, 11)
    return Trajectory(JOINTS, MOTION_S / 10, q, np.zeros_like(q), np.zeros_like(q))


def robot() -> RobotConfig:
    pose_ = {"xyz_m": (0.3, -0.15, 0.0)}
    return RobotConfig.model_validate(
        {
            "name": "fake",
            "device": "robot",
            "driver": "fci",
            "description": "no robot",
            "urdf": "none",
            "srdf": "none",
            "joints": JOINTS,
            "hand_link": "hand",
            "T_base_task": pose_,
            "home_q_rad": (0.0,) * 7,
            "look_q_rad": (LOOK,) * 7,
            "limits": {
                "velocity_rad_s": (1.0,) * 7,
                "acceleration_rad_s2": (1.0,) * 7,
                "jerk_rad_s3": (1.0,) * 7,
            },
            "gripper": {},
            "drop": {"bin_center_m": (0, 0.5, 0), "bin_size_m": (0.3, 0.3, 0.1), "q_rad": (DROP,) * 7},
        }
    )


def camera_config(recheck: bool = True) -> CameraConfig:
    return CameraConfig.model_validate(
        {
            "name": "fake",
            "device": "camera",
            "driver": "realsense",
            "description": "no camera",
            "width_px": 8,
            "height_px": 6,
            "simulated_fx_px": 8,
            "simulated_fy_px": 8,
            "simulated_cx_px": 4,
            "simulated_cy_px": 3,
            "frame_id": "cam",
            "recheck": {"enabled": recheck},
        }
    )


@dataclass
class FakeClock:
    """Time that only passes when somebody waits. `jump` is added once at the next reading."""

    t: float = 100.0
    jump: float = 0.0

    def now(self) -> float:
        self.t, self.jump = self.t + self.jump, 0.0
        return self.t

    def sleep(self, seconds: float) -> None:
        self.t += seconds


class _Device:
    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        return None


class FakeHandle:
    def __init__(self, arm: "FakeArm", trajectory: Trajectory, name: str) -> None:
        self.arm, self.trajectory, self.name = arm, trajectory, name
        self.t, self.cancelled = 0.0, False

    def wait(self, timeout: float) -> MotionResult | None:
        self.arm.lab.clock.sleep(timeout)
        hook = self.arm.during.get(self.name)
        if hook is not None:
            ended = hook(self)
            if ended is not None:
                return ended
        if self.cancelled:
            return MotionResult(False, "cancelled", 0.1)
        self.t += timeout
        k = min(int(self.t / self.trajectory.dt), len(self.trajectory.q) - 1)
        self.arm.q = self.trajectory.q[k].copy()
        done = self.t >= self.trajectory.duration
        return MotionResult(True, "reached", 0.0) if done else None

    def cancel(self) -> None:
        self.cancelled = True
        self.arm.cancels += 1


class FakeArm(_Device):
    """`during[name]` is called in every wait of the motion of that name and may end it or change the arm."""

    joint_names = JOINTS

    def __init__(self, lab: "Lab") -> None:
        self.lab = lab
        self.q = pose(0.3)
        self.mode, self.errors, self.wrench = ArmMode.IDLE, (), np.zeros(6)
        self.during: dict[str, Callable[[FakeHandle], MotionResult | None]] = {}
        self.cancels = self.recoveries = 0
        self.recover_fails = 0

    def state(self) -> ArmState:
        return ArmState(self.lab.clock.now(), self.q.copy(), np.zeros(7), self.mode, self.errors, self.wrench.copy())

    def execute(self, trajectory: Trajectory) -> FakeHandle:
        assert np.allclose(trajectory.q[0], self.q, atol=0.02), "the motion does not start where the arm is"
        return FakeHandle(self, trajectory, self.lab.motion)

    def recover(self, timeout: float) -> None:
        self.recoveries += 1
        if self.recover_fails > 0:
            self.recover_fails -= 1
            raise DeviceTimeout("the arm to be idle", timeout)
        self.mode, self.errors = ArmMode.IDLE, ()


class FakeGripper(_Device):
    """`lie` overrides what the device says about a grasp; the fingers do what the table's script says."""

    def __init__(self, lab: "Lab") -> None:
        self.lab, self.width, self.lie = lab, MAX_WIDTH, None
        self.stops, self.commands = 0, []
        self.during: Callable[[str], None] | None = None

    def state(self) -> GripperState:
        grasped = self.width > 0 if self.lie is None else self.lie
        return GripperState(self.lab.clock.now(), self.width, grasped)

    def homing(self, timeout: float) -> GripperResult:
        return GripperResult(True, MAX_WIDTH)

    def move(self, width: float, speed: float, timeout: float) -> GripperResult:
        self._command("move")
        self.lab.opened()
        self.width = width
        return GripperResult(True, width)

    def grasp(self, width, speed, force, epsilon_inner, epsilon_outer, timeout) -> GripperResult:
        assert width == 0.0 and epsilon_outer >= MAX_WIDTH, "the epsilon trap (anchors B1.1)"
        self._command("grasp")
        self.width = self.lab.closed()
        return GripperResult(self.width > 0 if self.lie is None else self.lie, self.width)

    def stop(self) -> None:
        self.stops += 1

    def _command(self, name: str) -> None:
        self.commands.append(name)
        self.lab.clock.sleep(0.3)
        if self.during is not None:
            self.during(name)


class FakeCamera(_Device):
    """`spoil` may replace a frame or raise."""

    intrinsics = Intrinsics(8, 6, 8.0, 8.0, 4.0, 3.0)
    frame_id = "cam"

    def __init__(self, lab: "Lab") -> None:
        self.lab, self.number = lab, 0
        self.spoil: Callable[[Frame], Frame] | None = None

    def capture(self, *, after: float, timeout: float) -> Frame:
        self.lab.clock.sleep(0.03)
        self.number += 1
        depth = np.full((6, 8), 500, dtype=np.uint16)
        color = np.full((6, 8, 3), self.lab.on_table(), dtype=np.uint8)
        frame = Frame(depth, 0.001, self.intrinsics, self.lab.clock.now(), "cam", color, self.number)
        return frame if self.spoil is None else self.spoil(frame)


class FakePerception:
    """Sees as many points as there are objects; an image without depth is a problem."""

    T_base_task = translation(0.3, -0.15, 0.0)

    def __init__(self, lab: "Lab") -> None:
        self.lab, self.fused = lab, []

    def T_base_cam(self, q: np.ndarray) -> np.ndarray:
        return translation(0.3, 0.0, 0.6)

    def clean(self, frame: Frame, q: np.ndarray) -> Frame:
        return frame

    def problem(self, frame: Frame, q: np.ndarray) -> str:
        return "" if (frame.depth > 0).any() else "the image holds no depth."

    def blind(self, frame: Frame, q: np.ndarray) -> str:
        return self.problem(frame, q)

    def view(self, frame: Frame, q: np.ndarray, further=()) -> View:
        self.fused.append(len(further))
        grid = TsdfGrid(np.zeros((40, 40, 40), np.float32), np.ones((40, 40, 40), bool))
        volume = CollisionVolume(np.zeros((2, 2, 2), bool), np.ones((2, 2, 2), bool), np.zeros(3), 0.0125)
        return View(grid, volume, 1000 * self.lab.on_table() if self.lab.sees else 0)

    def change(self, before, after, T_base_grasp: np.ndarray, radius: float, step: float) -> SceneChange:
        assert after[0].number > before[0].number, "the frame to compare with must be a fresh one"
        taken = 1e-3 * bool((before[0].color != after[0].color).any())
        return SceneChange(self.lab.moved.pop(0) if self.lab.moved else taken, 1.0)


class FakePlanner:
    """Three grasps, unless told otherwise."""

    name, weights_sha256 = "fake", "0" * 64

    def __init__(self) -> None:
        self.grasps: Grasps | None = None
        self.seeds: list[int] = []
        self.hook: Callable[[], None] | None = None

    def plan(self, grid: TsdfGrid, seed: int = 0) -> Grasps:
        self.seeds.append(seed)
        if self.hook is not None:
            self.hook()
        if self.grasps is not None:
            return self.grasps
        T = np.tile(translation(0.15, 0.15, 0.1), (3, 1, 1))
        return Grasps(T, np.full(3, 0.05), np.array([0.9, 0.8, 0.7]))


class FakeMotion:
    """Accepts the first grasp, unless `refuses`."""

    def __init__(self) -> None:
        self.refuses, self.routes_fail = False, 0
        self.seen: list[Grasps] = []

    def decide(self, grasps, T_base_task, view, q_start) -> Decision:
        self.seen.append(grasps)
        n = len(grasps)
        if self.refuses:
            return Decision((Verdict.IK,) * n, None, None, False)
        pick = ReadyPick(
            T_base_task @ grasps.T_task_grasp[0],
            line(q_start, PREGRASP),
            line(PREGRASP, GRASP),
            line(GRASP, LIFTED),
            line(LIFTED, DROP),
            line(DROP, LOOK),
            line(LIFTED, LOOK),
        )
        return Decision((Verdict.ACCEPTED, *(Verdict.NOT_EXAMINED,) * (n - 1)), pick, 0, False)

    def route(self, q_start, q_goal, view) -> Trajectory | None:
        if self.routes_fail > 0:
            self.routes_fail -= 1
            return None
        return line(q_start, q_goal)


@dataclass
class Lab:
    """Everything a test needs. `script` is one letter per closing of the gripper:
    S picks and delivers, F closes on nothing, L loses the object on the way, M drops it beside the bin, C has it
    cling to a finger above the bin.
    `moved` is the area that changed before each approach [m^2]; nothing once it is used up.
    """

    script: str = "SSSSSSSS"
    objects: int = 3
    has_referee: bool = True
    sees: bool = True
    events: list = field(default_factory=list)
    motion: str = ""
    settings: Settings = field(default_factory=Settings)
    listeners: list = field(default_factory=list)
    moved: list = field(default_factory=list)
    recheck: bool = True
    supervisor: object = None

    def __post_init__(self) -> None:
        self.clock, self.stop = FakeClock(), StopToken()
        self.arm, self.gripper, self.camera = FakeArm(self), FakeGripper(self), FakeCamera(self)
        self.planner, self.motion_planner, self.perception = FakePlanner(), FakeMotion(), FakePerception(self)
        self.letters, self.letter = iter(self.script), ""
        self.left, self.binned = self.objects, 0

    def over_bin(self) -> bool:
        return bool(np.allclose(self.arm.q, DROP, atol=0.05))

    def closed(self) -> float:
        if self.over_bin():
            return OBJECT_WIDTH if self.letter == "C" else 0.0
        self.letter = next(self.letters)
        return 0.0 if self.letter == "F" else OBJECT_WIDTH

    def opened(self) -> None:
        held = self.gripper.width == OBJECT_WIDTH
        if held and self.over_bin() and self.letter != "C":
            self.left -= 1
            self.binned += self.letter == "S"

    def in_bin(self) -> int:
        return self.binned

    def on_table(self) -> int:
        return self.left

    def prepare(self, round_index: int, seed: int) -> int:
        self.left, self.binned = self.objects, 0
        return self.objects

    def sink(self, event) -> None:
        self.events.append(event)
        if isinstance(event, MotionStarted):
            self.motion = event.name
            if event.name == "drop" and self.letter == "L":
                self.gripper.width = 0.0
        for listener in self.listeners:
            listener(event)

    def context(self) -> Context:
        return Context(
            Devices(self.camera, self.arm, self.gripper, self.clock),
            self.perception,
            self.planner,
            self.motion_planner,
            robot(),
            camera_config(self.recheck),
            self.sink,
            self if self.has_referee else None,
            self.stop,
            self.settings,
            supervisor=self.supervisor,
        )

    def run(self, rounds: int = 1, seeds: tuple[int, ...] = (0,)):
        return run_rounds(self.context(), self, seeds, rounds)

    def of(self, kind) -> list:
        return [event for event in self.events if isinstance(event, kind)]

    @property
    def states(self) -> list[str]:
        return [event.state for event in self.of(StateEntered)]

    @property
    def outcomes(self) -> list[str]:
        return [str(event.outcome) for event in self.of(AttemptFinished)]

    @property
    def reasons(self) -> list[str]:
        return [str(event.stop_reason) for event in self.of(RoundFinished)]

    @property
    def warnings(self) -> list[str]:
        return [event.cause for event in self.of(Warned)]


def once(action: Callable[[], object]) -> Callable[..., None]:
    """Does `action` at the first call only."""
    todo = [action]

    def hook(*_: object) -> None:
        if todo:
            todo.pop()()

    return hook


def reflex(arm: FakeArm) -> Callable[[FakeHandle], MotionResult | None]:
    """The motion ends in a reflex, once."""
    todo = [1]

    def hook(handle: FakeHandle) -> MotionResult | None:
        if not todo or handle.t < MOTION_S / 2:
            return None
        todo.pop()
        arm.mode, arm.errors = ArmMode.REFLEX, ("cartesian_reflex",)
        return MotionResult(False, "aborted: cartesian_reflex", 0.2)

    return hook


def refuse(*_: object) -> None:
    raise HardwareError("the device said no")
