"""One simulated cell with one scene in it; every pick begins anew from the same state."""

from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
import pybullet

from evg_app.benchmark.motion.baseline import StraightPick
from evg_app.benchmark.motion.config import MotionBenchmark
from evg_app.benchmark.motion.contacts import Contact, ContactJudge
from evg_app.benchmark.motion.limits import worst_ratios
from evg_app.benchmark.motion.truth import true_view
from evg_app.errors import EvgError
from evg_app.geometry import Array
from evg_app.motion.kinematics import Kinematics
from evg_app.motion.plan import PickPlan
from evg_app.motion.scene import SceneView
from evg_app.picking.perceive import TablePerception
from evg_app.simulation.arm import SimulatedArm
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.camera import SimulatedCamera
from evg_app.simulation.gripper import SimulatedGripper
from evg_app.simulation.state import SceneState
from evg_app.simulation.world import SimWorld
from evg_app.types import Frame, Trajectory

SLACK = 5.0
"""A motion may take this much longer than its trajectory [s]."""
NOT_CLOSED = 0.001
"""An opening this close to the widest is a gripper that never closed [m]."""
MOVED = (0.03, 0.0, 0.0)
"""How the target is moved to see whether the look before the approach notices [m]."""
BEFORE_CLOSING = ("reach", "approach")
"""Motions in which nothing may be touched."""


@dataclass(frozen=True)
class Executed:
    """What happened when a pick was executed.

    Attributes:
        ended: "done", or why a motion fell short and the pick ended there.
        before: contacts with anything but the target before the fingers closed.
        after: the same from closing on.
        target_before: whether the target was touched before the fingers closed.
        held: whether something was between the fingers after the lift.
        delivered: whether the target ended in the bin.
        ratios: of the samples that were sent, see `limits.worst_ratios`.
        seconds: simulated time [s].
        still, moved: area that the look before the approach found changed, as everything was, and with the target
            moved by `MOVED` [m^2]; None without that look.
    """

    ended: str
    before: tuple[Contact, ...]
    after: tuple[Contact, ...]
    target_before: bool
    held: bool
    delivered: bool
    ratios: dict[str, float]
    seconds: float
    still: float | None = None
    moved: float | None = None


@dataclass(frozen=True)
class Observation:
    """A noisy look at the scene: for the planner, the frame itself with the arm at q (7,), and who made it."""

    view: SceneView
    frame: Frame
    q: Array
    perception: TablePerception


class Cell:
    """A scene in PyBullet with arm, gripper and camera. A context manager."""

    def __init__(self, config: MotionBenchmark, seed: int, number: int) -> None:
        """Build scene `number` of `seed`.

        Raises:
            EvgError: the configuration or the scene cannot be used.
        """
        self.robot, camera = config.robot_config(), config.camera_config()
        self._camera_config = camera
        self._world = SimWorld(self.robot, config.world_config(number), builtin_objects("test"))
        try:
            self._arm, self._gripper = SimulatedArm(self._world), SimulatedGripper(self._world)
            self._camera = SimulatedCamera(self._world, camera)
            words = np.random.SeedSequence([seed, number]).generate_state(1, np.uint32)
            self._world.new_round(int(words[0]))
            self._judge = ContactJudge(self._world)
            self._rest(pybullet.ACTIVATION_STATE_ENABLE_SLEEPING)
            self._saved = self._world.client.saveState()
        except EvgError:
            self._world.close()
            raise
        self._sent: list[Trajectory] = []

    def __enter__(self) -> Self:
        """The cell is ready."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Free the physics."""
        self._world.close()

    @property
    def T_base_task(self) -> Array:
        """Where the workspace is. Shape (4, 4)."""
        return self._world.T_base_task

    def state(self) -> SceneState:
        """The objects as they lie."""
        return self._world.scene()

    def q(self) -> Array:
        """Where the arm is [rad]. Shape (7,)."""
        return self._arm.state().q

    def true_view(self) -> SceneView:
        """The scene without noise, occlusion and unknown space."""
        return true_view(self.state(), self.T_base_task)

    def observe(self, kinematics: Kinematics) -> Observation:
        """One noisy depth image from the saved state, and what the loop makes of it."""
        ruler = self._camera_config.table_is_ruler
        perception = TablePerception(
            self.T_base_task, lambda q: self._camera.T_base_cam, kinematics.link_primitives, ruler
        )
        q, frame = self.q(), self._picture()
        view = perception.view(perception.clean(frame, q), q)
        return Observation(SceneView(view.tsdf, view.volume), frame, q, perception)

    def execute(self, pick: PickPlan | StraightPick, target: int, seen: Observation | None = None) -> Executed:
        """Carry a pick out from the saved state; the baseline ends where the fingers would close.

        Args:
            pick: what to do.
            target: index of the object that is to be grasped.
            seen: what it was planned on, to be compared with a fresh look before the approach.
        """
        self._renew()
        start, in_hand = self._world.time, False
        ended = self._follow("reach", pick.reach)
        changes: tuple[float | None, float | None] = (None, None)
        if isinstance(pick, PickPlan) and seen is not None and not ended:
            changes = self._look_again(pick, target, seen)
        ended = ended or self._follow("approach", pick.approach)
        if isinstance(pick, PickPlan) and not ended:
            gripper = self.robot.gripper
            self._judge.phase = "close"
            inner, outer = gripper.epsilon_inner_m, gripper.epsilon_outer_m
            self._gripper.grasp(0.0, gripper.speed_m_s, gripper.force_n, inner, outer, gripper.timeout_s)
            ended = self._follow("lift", pick.lift)
            in_hand = gripper.held_width_m < self._gripper.state().width < gripper.max_width_m - NOT_CLOSED
            ended = ended or self._finish(pick, in_hand)
        self._judge.phase = ""
        name, contacts = self._judge.name_of(target), self._judge.contacts()
        before = tuple(c for c in contacts if c.phase in BEFORE_CLOSING)
        return Executed(
            ended=ended or "done",
            before=tuple(c for c in before if c.other != name),
            after=tuple(c for c in contacts if c.phase not in BEFORE_CLOSING and c.other != name),
            target_before=any(c.other == name for c in before),
            held=in_hand,
            delivered=name in self._world.truth().in_bin,
            ratios=worst_ratios(self._sent, self.robot),
            seconds=self._world.time - start,
            still=changes[0],
            moved=changes[1],
        )

    def _look_again(self, pick: PickPlan, target: int, seen: Observation) -> tuple[float, float]:
        """Changed areas [m^2] near the grasp: as everything is, and as if the target had been moved meanwhile."""
        still = self._changed(pick, seen)
        client, body = self._world.client, self._world.placed[target].body
        position, turn = client.getBasePositionAndOrientation(body)
        client.resetBasePositionAndOrientation(body, (np.array(position) + MOVED).tolist(), turn)
        moved = self._changed(pick, seen)
        client.resetBasePositionAndOrientation(body, position, turn)
        return still, moved

    def _changed(self, pick: PickPlan, seen: Observation) -> float:
        """Area that a fresh look finds changed near the grasp [m^2]."""
        model = self._camera_config.recheck
        fresh = (self._picture(), self.q())
        before = (seen.frame, seen.q)
        return seen.perception.change(before, fresh, pick.T_base_grasp, model.radius_m, model.depth_m).area

    def _picture(self) -> Frame:
        """A depth image of now."""
        return self._camera.capture(after=self._world.time, timeout=SLACK)

    def _finish(self, pick: PickPlan, in_hand: bool) -> str:
        """To the bin and back with something in the hand, else straight back; why it fell short, or empty."""
        if not in_hand:
            self._open()
            return self._follow("retreat", pick.retreat)
        ended = self._follow("transport", pick.transport)
        self._open()
        return ended or self._follow("back", pick.back)

    def _open(self) -> None:
        """Open the gripper wide."""
        gripper = self.robot.gripper
        self._judge.phase = "open"
        self._gripper.move(gripper.max_width_m, gripper.speed_m_s, gripper.timeout_s)

    def _follow(self, phase: str, trajectory: Trajectory) -> str:
        """Execute a trajectory to its end; why it fell short, or empty."""
        self._judge.phase = phase
        self._sent.append(trajectory)
        result = self._arm.execute(trajectory).wait(trajectory.duration + SLACK)
        if result is None:
            return f"{phase}: did not end"
        return "" if result.reached else f"{phase}: {result.reason}"

    def _rest(self, state: int) -> None:
        """Put the objects to sleep, or let them fall asleep: physics leaves them out until something touches them."""
        for thing in self._world.placed:
            self._world.client.changeDynamics(thing.body, -1, activationState=state)

    def _renew(self) -> None:
        """Everything as it was when the scene was built."""
        self._world.client.restoreState(stateId=self._saved)
        self._rest(pybullet.ACTIVATION_STATE_SLEEP)
        for renew in self._world.on_reset:
            renew()
        self._world.solve_finely(False)
        self._sent = []
        self._judge.begin()
