"""The guard: the tool stays in its box, a person agrees, and nothing moves by itself after a protective stop."""

import numpy as np
import pytest

from evg_app.config.franka import ToolBox
from evg_app.errors import DeviceTimeout, HardwareError, Refused, Stopped
from evg_app.events import MotionStarted
from evg_app.robots.guard import GuardedArm
from evg_app.types import ArmMode, ArmState, MotionResult, Trajectory

BOX = ToolBox(low_m=(-1.0, -1.0, 0.0), high_m=(1.0, 1.0, 1.0))


class Motion:
    """Ends at once with `result`."""

    def __init__(self, result: MotionResult) -> None:
        self.result, self.cancels = result, 0

    def wait(self, timeout: float) -> MotionResult | None:
        return self.result

    def cancel(self) -> None:
        self.cancels += 1


class Arm:
    """Two joints; notes what it is told."""

    joint_names = ("a", "b")

    def __init__(self) -> None:
        self.mode, self.errors, self.sent, self.recoveries = ArmMode.IDLE, (), [], 0
        self.result = MotionResult(True, "reached", 0.0)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def state(self) -> ArmState:
        return ArmState(0.0, np.zeros(2), np.zeros(2), self.mode, self.errors)

    def execute(self, trajectory: Trajectory) -> Motion:
        self.sent.append(trajectory)
        return Motion(self.result)

    def recover(self, timeout: float) -> None:
        self.recoveries += 1
        self.mode, self.errors = ArmMode.IDLE, ()


class Person:
    """Answers questions from a list."""

    def __init__(self, *answers: bool) -> None:
        self.answers, self.questions = list(answers), []

    def __call__(self, question: str) -> bool:
        self.questions.append(question)
        return self.answers.pop(0)


def tool_path(q: np.ndarray) -> np.ndarray:
    """The first joint is the tool's height."""
    return np.stack([np.zeros(len(q)), q[:, 1], q[:, 0]], axis=1)


def way(height: float, samples: int = 101) -> Trajectory:
    """From 0.5 m up to a height and back."""
    s = np.sin(np.linspace(0, np.pi, samples))
    q = np.stack([0.5 + (height - 0.5) * s, np.zeros(samples)], axis=1)
    return Trajectory(("a", "b"), 0.01, q, np.zeros_like(q), np.zeros_like(q))


def guarded(arm: Arm, acknowledge: Person | None = None, **words) -> GuardedArm:
    return GuardedArm(arm, tool_path, BOX, acknowledge or Person(), **words)


def test_a_motion_inside_the_box_is_sent():
    arm = Arm()
    assert guarded(arm).execute(way(0.9)).wait(0.1).reached
    assert len(arm.sent) == 1


@pytest.mark.parametrize("height", [1.2, -0.01])
def test_a_motion_that_leaves_the_box_in_its_middle_is_refused_and_not_sent(height):
    arm = Arm()
    with pytest.raises(Refused, match=r"beyond tool_box in z; nothing was sent"):
        guarded(arm).execute(way(height))
    assert arm.sent == []


def test_each_motion_is_asked_for_by_name_and_a_no_ends_the_run():
    arm, person = Arm(), Person(True, False)
    guard = guarded(arm, step=person)
    guard.listen(MotionStarted("reach", 1.0))
    guard.execute(way(0.6))
    guard.listen(MotionStarted("approach", 1.0))
    with pytest.raises(Stopped):
        guard.execute(way(0.6))
    assert len(arm.sent) == 1
    assert person.questions[0].startswith("reach: 1.0 s, tool from (0.000, 0.000, 0.500)")
    assert person.questions[1].startswith("approach")


def test_a_dry_run_sends_nothing():
    arm = Arm()
    with pytest.raises(Refused, match="dry run"):
        guarded(arm, dry=True).execute(way(0.6))
    assert arm.sent == []


@pytest.mark.parametrize("mode", [ArmMode.REFLEX, ArmMode.USER_STOPPED])
def test_after_a_protective_stop_nothing_moves_until_a_person_agrees(mode):
    arm, person = Arm(), Person(True)
    guard = guarded(arm, person)
    arm.result = MotionResult(False, "stopped", 0.3)
    motion = guard.execute(way(0.6))
    arm.mode = mode
    assert not motion.wait(0.1).reached
    arm.mode, arm.result = ArmMode.IDLE, MotionResult(True, "reached", 0.0)
    with pytest.raises(HardwareError, match="stopped by itself"):
        guard.execute(way(0.6))
    guard.recover(1.0)
    assert arm.recoveries == 1 and len(person.questions) == 1
    assert guard.execute(way(0.6)).wait(0.1).reached


def test_a_no_is_asked_once_and_stays_a_no():
    arm, person = Arm(), Person(False)
    arm.mode, arm.errors = ArmMode.REFLEX, ("joint_reflex",)
    guard = guarded(arm, person)
    for _ in range(3):
        with pytest.raises(HardwareError, match="nobody let it go on; it holds"):
            guard.recover(1.0)
    assert arm.recoveries == 0 and len(person.questions) == 1
    assert "joint_reflex" in person.questions[0]


def test_a_motion_that_only_fell_short_needs_nobody():
    arm = Arm()
    arm.result = MotionResult(False, "contact of 30 N", 0.1)
    guard = guarded(arm)
    guard.execute(way(0.6)).wait(0.1)
    guard.recover(1.0)
    assert arm.recoveries == 1


def test_cancel_reaches_the_arm():
    arm = Arm()
    motion = guarded(arm).execute(way(0.6))
    motion.cancel()
    assert motion._motion.cancels == 1


def test_a_state_that_is_lost_while_the_arm_moves_needs_a_person_and_one_lost_at_rest_does_not():
    arm, person = Arm(), Person(False)
    guard, state, fresh = guarded(arm, person), arm.state, [True]

    def seen() -> ArmState:
        if not fresh[0]:
            raise DeviceTimeout("/joint_states", 0.5)
        return state()

    arm.state = seen
    fresh[0] = False
    with pytest.raises(DeviceTimeout):
        guard.state()
    guard.recover(1.0)
    assert arm.recoveries == 1
    fresh[0] = True
    guard.listen(MotionStarted("approach", 1.0))
    guard.execute(way(0.6))
    fresh[0] = False
    with pytest.raises(DeviceTimeout):
        guard.state()
    with pytest.raises(HardwareError, match=r"contact was lost during 'approach'.*nobody let it go on"):
        guard.recover(1.0)


class Vanishing(Motion):
    """Contact is lost while it moves."""

    def wait(self, timeout: float) -> MotionResult | None:
        raise DeviceTimeout("/joint_states (last one 0.61 s old)", 0.5, "Run: ros2 launch x y")


def test_after_a_motion_was_lost_from_sight_an_arm_that_comes_back_moves_only_when_a_person_agrees():
    arm, person = Arm(), Person(False)
    guard = guarded(arm, person)
    arm.execute = lambda trajectory: Vanishing(arm.result)
    guard.listen(MotionStarted("reach", 1.0))
    with pytest.raises(DeviceTimeout, match="Run: ros2 launch"):
        guard.execute(way(0.6)).wait(0.1)
    with pytest.raises(HardwareError, match=r"contact was lost during 'reach'.*recover\(\) first"):
        guard.execute(way(0.6))
    with pytest.raises(HardwareError, match="nobody let it go on; it holds"):
        guard.recover(1.0)
    assert arm.recoveries == 0 and "contact was lost during 'reach'" in person.questions[0]
