"""What the loop does with the arm and the gripper: every wait has a name, a timeout and an eye on the stop token."""

from collections.abc import Callable

import numpy as np

from evg_app.errors import DeviceTimeout, HardwareError
from evg_app.events import GripperMoved, MotionEnded, MotionStarted, Routed, Stage, Warned
from evg_app.geometry import Array
from evg_app.picking.session import Round
from evg_app.picking.waiting import Budget, measured
from evg_app.robots.protocol import MotionHandle
from evg_app.types import ArmMode, ArmState, GripperResult, GripperState, MotionResult, Trajectory

CANCEL_TIMEOUT = 2.0
"""How long a cancelled motion may take to end [s]."""
OPEN_MARGIN = 0.004
"""The gripper counts as open within this of its widest opening [m]."""
REST_SLICE, REST_STEP, REST_TIMEOUT = 0.1, 0.001, 1.0
"""Fingers rest when they move by less than the step [m] in a slice [s]; longer than the timeout [s] nobody waits."""

CONTACT = "contact"
"""How the reason of a motion starts that contact ended."""

Guard = Callable[[], str]
"""Looks at the arm during a motion; a reason to cancel it, or empty."""


def contact_guard(round_: Round) -> Guard:
    """Cancels when the force [N] departs too far from what it was at rest, some looks in a row.

    A software limit, not a safety function. The force at rest is averaged and subtracted because the estimate carries
    the error of payload and gravity (spec §7.4). Torques [Nm] are not looked at.
    """
    arm, limit, slices = round_.ctx.devices.arm, round_.ctx.robot.contact_force_n, round_.ctx.settings.contact_slices
    rest, above = _force_at_rest(round_), 0

    def look() -> str:
        """Why to stop now; nothing while all is well."""
        nonlocal above
        force = float(np.linalg.norm(arm.state().wrench[:3] - rest))
        above = above + 1 if force > limit else 0
        return f"{CONTACT} of {force:.0f} N (limit {limit:g} N)" if above >= slices else ""

    return look


def _force_at_rest(round_: Round) -> Array:
    """Mean force [N] over the configured time, base frame. Shape (3,)."""
    ctx = round_.ctx
    budget = Budget(ctx.devices.clock, ctx.robot.contact.bias_s, ctx.settings.slice_s)
    forces = [ctx.devices.arm.state().wrench[:3]]
    while ctx.robot.contact.bias_s > budget.elapsed:
        ctx.stop.check()
        ctx.devices.clock.sleep(ctx.settings.slice_s)
        forces.append(ctx.devices.arm.state().wrench[:3])
        budget.spend()
    mean: Array = np.mean(forces, axis=0)
    return mean


def follow(round_: Round, name: str, trajectory: Trajectory, guard: Guard | None = None) -> MotionResult:
    """Execute a trajectory to its end, a contact, or a stop.

    Raises:
        DeviceTimeout: it did not end in time; it was cancelled.
        HardwareError: the arm reports a reflex or an error.
        Stopped: the user asked twice; it was cancelled.
    """
    ctx, settings = round_.ctx, round_.ctx.settings
    round_.emit(MotionStarted(name, trajectory.duration))
    timeout = trajectory.duration * settings.motion_slack + settings.motion_grace_s
    budget = Budget(ctx.devices.clock, timeout, settings.slice_s)
    with ctx.stop.shielded():
        handle = round_.active = ctx.devices.arm.execute(trajectory)
    try:
        result = _wait(round_, handle, name, budget, timeout, guard)
    except BaseException:
        handle.cancel()
        raise
    finally:
        round_.active = None
        round_.now.motion_s += budget.elapsed
    round_.emit(MotionEnded(name, result, budget.elapsed))
    if not result.reached:
        require_healthy(ctx.devices.arm.state(), result.reason)
    return result


def _wait(
    round_: Round, handle: MotionHandle, name: str, budget: Budget, timeout: float, guard: Guard | None
) -> MotionResult:
    """Slice by slice, until the motion ends, contact stops it, or time is up."""
    ctx = round_.ctx
    while True:
        result = handle.wait(ctx.settings.slice_s)
        if result is not None:
            budget.spend()
            return result
        ctx.stop.check()
        ctx.tick()
        contact = guard() if guard is not None else ""
        if contact:
            return _cancelled(round_, handle, contact)
        if not budget.spend():
            raise DeviceTimeout(f"the motion '{name}' to end", timeout, "It was cancelled. Is the arm moving freely?")


def _cancelled(round_: Round, handle: MotionHandle, reason: str) -> MotionResult:
    """Cancel and wait until the arm has stopped."""
    settings = round_.ctx.settings
    handle.cancel()
    budget = Budget(round_.ctx.devices.clock, CANCEL_TIMEOUT, settings.slice_s)
    while (result := handle.wait(settings.slice_s)) is None:
        if not budget.spend():
            raise DeviceTimeout("a cancelled motion to stop", CANCEL_TIMEOUT, "Press the stop button of the robot.")
    return MotionResult(False, reason, result.goal_error)


def require_healthy(state: ArmState, what: str) -> None:
    """Pass when the arm reports no error.

    Raises:
        HardwareError: with the mode and the errors.
    """
    if state.errors or state.mode in (ArmMode.REFLEX, ArmMode.USER_STOPPED):
        raise HardwareError(f"{what}; the arm is in mode '{state.mode}', errors: {', '.join(state.errors) or 'none'}")


def at(round_: Round, q: Array) -> bool:
    """Whether the arm is at `q` [rad], shape (J,)."""
    gap = np.abs(round_.ctx.devices.arm.state().q - q).max(initial=0.0)
    return bool(gap < round_.ctx.settings.at_pose_rad)


def go_to(round_: Round, name: str, q_goal: Array, around_scene: bool = True) -> MotionResult:
    """Plan a way to `q_goal` [rad] and go there; around the last view when there is such a way.

    Raises:
        HardwareError: there is no way at all, or as `follow`.
    """
    if at(round_, q_goal):
        return MotionResult(True, "reached", 0.0)
    q_start = round_.ctx.devices.arm.state().q
    view = round_.now.view if around_scene else None
    with round_.timed(Stage.ROUTE):
        way = round_.ctx.motion.route(q_start, q_goal, view)
        if way is None and view is not None:
            round_.emit(Warned("route", f"no way around the scene for '{name}'; using one around the table only"))
            view = None
            way = round_.ctx.motion.route(q_start, q_goal, None)
    if way is None:
        raise HardwareError(f"no collision-free way for '{name}' from {np.round(q_start, 3).tolist()}")
    round_.emit(Routed(name, q_start, q_goal, view is not None, way))
    return follow(round_, name, way)


def backwards(trajectory: Trajectory) -> Trajectory:
    """The same path from its end to its start, within the same limits."""
    q, dq, ddq = trajectory.q[::-1], -trajectory.dq[::-1], trajectory.ddq[::-1]
    return Trajectory(trajectory.joint_names, trajectory.dt, q.copy(), dq.copy(), ddq.copy())


def open_gripper(round_: Round) -> None:
    """Open all the way, unless it is open.

    Raises:
        HardwareError: it did not open.
    """
    ctx, gripper = round_.ctx, round_.ctx.robot.gripper
    wanted = gripper.max_width_m - OPEN_MARGIN
    if ctx.devices.gripper.state().width >= wanted:
        return
    start = ctx.devices.clock.now()
    result = ctx.devices.gripper.move(gripper.max_width_m, gripper.speed_m_s, gripper.timeout_s)
    _gripper_moved(round_, "open", result, start)
    width = ctx.devices.gripper.state().width
    if width < gripper.max_width_m / 2:
        raise HardwareError(f"the gripper did not open: {width * 1e3:.1f} mm. {result.message}")


def close_gripper(round_: Round) -> GripperResult:
    """Close with width 0 and a wide epsilon: the device's verdict is kept, not trusted (anchors B1.1)."""
    ctx, gripper = round_.ctx, round_.ctx.robot.gripper
    start = ctx.devices.clock.now()
    result = ctx.devices.gripper.grasp(
        0.0,
        gripper.speed_m_s,
        gripper.force_n,
        gripper.epsilon_inner_m,
        gripper.epsilon_outer_m,
        gripper.timeout_s,
    )
    _gripper_moved(round_, "close", result, start)
    return result


def resting_fingers(round_: Round) -> GripperState:
    """The gripper's state once its fingers rest: they still close when the object was lost on the last stretch.

    After `REST_TIMEOUT` the state is taken as it is.
    """
    ctx = round_.ctx
    budget, before = Budget(ctx.devices.clock, REST_TIMEOUT, REST_SLICE), ctx.devices.gripper.state()
    while True:
        ctx.stop.check()
        ctx.devices.clock.sleep(REST_SLICE)
        now = ctx.devices.gripper.state()
        if abs(now.width - before.width) < REST_STEP or not budget.spend():
            return now
        before = now


def _gripper_moved(round_: Round, command: str, result: GripperResult, start: float) -> None:
    """Tell the listeners about a gripper command that ended."""
    ctx = round_.ctx
    seconds = measured(ctx.devices.clock, start, ctx.robot.gripper.timeout_s)
    round_.now.motion_s += seconds
    round_.emit(GripperMoved(command, result, seconds))
    ctx.tick()
