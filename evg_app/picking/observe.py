"""Observe: a fresh, healthy frame with the arm at rest, fused for the planner and the motion."""

from collections.abc import Callable
from typing import Literal

from evg_app.errors import DeviceTimeout, HardwareError
from evg_app.events import FrameTaken, Fused, Stage, Warned
from evg_app.geometry import Array
from evg_app.picking.session import Round
from evg_app.picking.states import Outcome
from evg_app.picking.waiting import Budget, measured
from evg_app.types import Frame


def observe(round_: Round) -> Literal[Outcome.OK, Outcome.EMPTY, Outcome.CLEARED]:
    """Take a frame and fuse it. An empty view is `CLEARED` unless the referee knows of objects left."""
    referee, attempt = round_.ctx.referee, round_.now
    if referee is not None and referee.on_table() == 0:
        return Outcome.CLEARED
    q = arm_at_rest(round_)
    frame = healthy_frame(round_, q)
    perception = round_.ctx.perception
    round_.emit(FrameTaken(frame, q, perception.T_base_cam(q), perception.T_base_task))
    with round_.timed(Stage.FILTER):
        clean = perception.clean(frame, q)
    with round_.timed(Stage.FUSE):
        view = perception.view(clean, q, attempt.further)
    round_.emit(Fused(view.tsdf, view.points, view.depth_factor, view.volume))
    attempt.frame, attempt.q, attempt.view = frame, q, view
    if view.points >= round_.ctx.settings.empty_points:
        return Outcome.OK
    attempt.empty = True
    return Outcome.CLEARED if referee is None else Outcome.EMPTY


def arm_at_rest(round_: Round) -> Array:
    """Joint positions [rad] once the arm has come to rest. Shape (J,)."""
    ctx, settings = round_.ctx, round_.ctx.settings
    budget = Budget(ctx.devices.clock, settings.rest_timeout_s, settings.slice_s)
    while True:
        state = ctx.devices.arm.state()
        if abs(state.dq).max(initial=0.0) < settings.rest_rad_s:
            return state.q
        ctx.stop.check()
        ctx.devices.clock.sleep(settings.slice_s)
        if not budget.spend():
            raise DeviceTimeout("the arm to come to rest", settings.rest_timeout_s, "Is something pushing it?")


def healthy_frame(round_: Round, q: Array) -> Frame:
    """A frame exposed from now on that may be planned on, in a bounded number of tries.

    Raises:
        HardwareError: the camera gave none; the message holds the last problem.
    """
    return fresh_frame(round_, lambda frame: round_.ctx.perception.problem(frame, q))


def fresh_frame(round_: Round, judge: Callable[[Frame], str]) -> Frame:
    """A frame exposed from now on in which `judge` finds no problem, in a bounded number of tries.

    Raises:
        HardwareError: the camera gave none; the message holds the last problem.
    """
    problem = ""
    for _ in range(round_.ctx.settings.capture_tries):
        round_.ctx.stop.check()
        try:
            frame = _capture(round_)
        except DeviceTimeout as error:
            problem = str(error)
            round_.emit(Warned("camera timeout", problem))
            continue
        problem = _stale(round_, frame) or judge(frame)
        if not problem:
            round_.last_frame = (frame.number, frame.stamp)
            return frame
        round_.emit(Warned("frame refused", problem))
    tries = round_.ctx.settings.capture_tries
    raise HardwareError(f"no usable depth image in {tries} tries: {problem} Run: evg-app doctor")


def _capture(round_: Round) -> Frame:
    """One frame, timed."""
    clock, timeout = round_.ctx.devices.clock, round_.ctx.camera.frame_timeout_s
    start = clock.now()
    try:
        with round_.timed(Stage.CAPTURE, counts=False):
            return round_.ctx.devices.camera.capture(after=start, timeout=timeout)
    finally:
        round_.now.motion_s += measured(clock, start, timeout)


def _stale(round_: Round, frame: Frame) -> str:
    """Why this frame is not a new one, empty when it is; a frame with a higher number is, even if a clock jumped."""
    if round_.last_frame is None:
        return ""
    number, stamp = round_.last_frame
    if frame.stamp <= stamp and frame.number <= number:
        return f"the camera repeated an old frame (number {frame.number}, stamp {frame.stamp:.3f} s)."
    if frame.number == number and number != 0:
        return f"the camera sent frame number {number} twice."
    return ""
