"""The code under replay: the loop's own states, fed by the log instead of by devices."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import ValidationError

from evg_app.clock import WallClock
from evg_app.config.models import CameraConfig, RobotConfig
from evg_app.errors import BadInput, HardwareError
from evg_app.events import AttemptOutcome
from evg_app.geometry import Array
from evg_app.grasping.protocol import Planner
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.slower import slowed
from evg_app.picking.context import Context, Devices
from evg_app.picking.evidence import in_window, judge, signs_of
from evg_app.picking.machine import HANDLERS
from evg_app.picking.motion import PlannedMotion
from evg_app.picking.perceive import TablePerception
from evg_app.picking.session import Attempt, Emitter, Round
from evg_app.picking.slowed import SlowedMotion
from evg_app.picking.states import Outcome, State
from evg_app.robots.protocol import MotionHandle
from evg_app.trials.arrays import Gathered, frame_of, routes_of, views_of
from evg_app.trials.recorded import RecordedAttempt
from evg_app.types import ArmMode, ArmState, Frame, GripperResult, GripperState, Intrinsics, Trajectory, Verdict
from evg_app.unconnected import Unconnected

DEVICE_ERROR = "device error"
"""Why an attempt failed that no judgement concluded."""
STEPS = {"fused": State.OBSERVE, "planned": State.PLAN, "judged": State.FILTER}
"""The state of the loop that brings a pass this far."""


class Playback:
    """Implements `trials.replay.Pipeline` with the code that runs.

    Args:
        config: the logged snapshot, with `robot` and `camera`.
        planner: proposes grasps; the logged one, or another to see what it would have done.

    Raises:
        BadInput: the snapshot does not describe a robot and a camera.
    """

    def __init__(self, config: Mapping[str, Any], planner: Planner) -> None:
        try:
            self._robot = RobotConfig.model_validate(config["robot"])
            self._camera = CameraConfig.model_validate(config["camera"])
        except (KeyError, ValidationError) as error:
            raise BadInput(f"the logged configuration cannot be used by this version of evg-app: {error}") from error
        self._planner, self._motion = planner, MotionPlanner(self._robot)
        self._speed_share = float(config.get("speed_share", 1.0))

    @property
    def weights_sha256(self) -> str:
        """Of the planner, empty without weights."""
        return self._planner.weights_sha256

    def recompute(self, attempt: RecordedAttempt) -> Gathered:
        """The states observe, plan and filter on the logged frame, as far as the attempt came.

        Raises:
            EvgError: the loop refuses the frame.
        """
        gathered = Gathered()
        if "frame" not in attempt.reached:
            return gathered
        round_ = self._round(attempt, gathered)
        for name, state in STEPS.items():
            if name not in attempt.reached or HANDLERS[state](round_) is not Outcome.OK:
                break
        for route in routes_of(attempt.stored):
            view = round_.now.view if route.around_scene else None
            way = round_.ctx.motion.route(route.q_start, route.q_goal, view)
            if way is not None:
                gathered.take(replace(route, way=way))
        return gathered

    def verified(self, attempt: RecordedAttempt) -> bool | None:
        """The loop's rule on the logged openings and looks; None when the fingers never closed."""
        seen, gripper = attempt.evidence, self._robot.gripper
        if seen.width_closed is None:
            return None
        if AttemptOutcome(attempt.outcome).counts and attempt.failure != DEVICE_ERROR:
            return judge(signs_of(seen), gripper, self._robot.evidence).held
        lifted, released = seen.width_lifted, seen.width_release  # the pass was never concluded
        if lifted is None:
            return None
        return in_window(lifted, gripper) and released is not None and in_window(released, gripper)

    def _round(self, attempt: RecordedAttempt, gathered: Gathered) -> Round:
        """A pass that stands where it was logged, with devices that only know the log."""
        taken, views = frame_of(attempt.stored), views_of(attempt.stored)
        poses = {view.q.tobytes(): view.T_base_cam for view in views} | {taken.q.tobytes(): taken.T_base_cam}
        perception = TablePerception(
            taken.T_base_task,
            lambda q: poses[q.tobytes()],
            self._motion.kinematics.link_primitives,
            self._camera.table_is_ruler,
            self._camera.min_valid_ratio,
        )
        arm = _LoggedArm(taken.q, self._robot.joints)
        ctx = Context(
            devices=Devices(_LoggedCamera(taken.frame), arm, _NoGripper(), WallClock()),
            perception=perception,
            planner=self._planner,
            motion=SlowedMotion(PlannedMotion(self._motion), lambda path: slowed(path, self._speed_share)),
            robot=self._robot,
            camera=self._camera,
            sink=gathered.take,
        )
        round_ = Round(ctx, Emitter(ctx.sink, ctx.stop), attempt.seed, attempt.round_index, None)
        round_.attempt = Attempt(attempt.attempt_id, attempt.index, attempt.planner_seed)
        said = attempt.stored.get("verdict", ())
        round_.attempt.rejected.update(i for i, word in enumerate(said) if str(word) == Verdict.REJECTED)
        round_.attempt.further.extend((perception.clean(view.frame, view.q), view.q) for view in views)
        return round_


class _LoggedCamera(Unconnected):
    """Always gives the logged frame."""

    def __init__(self, frame: Frame) -> None:
        self._frame, self.frame_id = frame, frame.frame_id

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the logged frame."""
        return self._frame.intrinsics

    def capture(self, *, after: float, timeout: float) -> Frame:
        """The logged frame, whenever it is asked for."""
        return self._frame


class _LoggedArm(Unconnected):
    """At rest where it was when the frame was taken; nothing moves in a replay."""

    def __init__(self, q: Array, joints: tuple[str, ...]) -> None:
        self._q, self.joint_names = q, joints

    def state(self) -> ArmState:
        """Where it stood."""
        return ArmState(0.0, self._q, np.zeros_like(self._q), ArmMode.IDLE)

    def execute(self, trajectory: Trajectory) -> MotionHandle:
        """Refused."""
        raise HardwareError("a replay moves nothing")

    def recover(self, timeout: float) -> None:
        """Refused."""
        raise HardwareError("a replay recovers nothing")


class _NoGripper(Unconnected):
    """Nothing is gripped in a replay."""

    def state(self) -> GripperState:
        """Refused."""
        raise HardwareError("a replay has no gripper")

    def homing(self, timeout: float) -> GripperResult:
        """Refused."""
        raise HardwareError("a replay has no gripper")

    def move(self, width: float, speed: float, timeout: float) -> GripperResult:
        """Refused."""
        raise HardwareError("a replay has no gripper")

    def grasp(
        self, width: float, speed: float, force: float, epsilon_inner: float, epsilon_outer: float, timeout: float
    ) -> GripperResult:
        """Refused."""
        raise HardwareError("a replay has no gripper")

    def stop(self) -> None:
        """Refused."""
        raise HardwareError("a replay has no gripper")
