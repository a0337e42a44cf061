"""`evg-app run` on hardware: what it asks, checks and hands to the loop. Its limits are not a safety function."""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from evg_app.cli.console import say
from evg_app.cli.operator import Operator, supervisor
from evg_app.cli.protocols import Procedure
from evg_app.cli.real_lab import RealLab, Wishes, build_real_lab, entered
from evg_app.cli.stopping import stop_file, stop_now
from evg_app.config.calibration import Calibration
from evg_app.config.models import CameraConfig, RobotConfig
from evg_app.config.speed import confirm_speed, confirmed_speed
from evg_app.errors import HardwareError
from evg_app.events import Sink, Warned, fan_out
from evg_app.grasping.protocol import Planner
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.slower import slowed
from evg_app.picking.context import Context, Devices, Rounds, Settings
from evg_app.picking.dry import dry_run
from evg_app.picking.motion import PlannedMotion
from evg_app.picking.perceive import TablePerception
from evg_app.picking.preflight import check_depth
from evg_app.picking.run import RunResult, run_rounds
from evg_app.picking.slowed import SlowedMotion
from evg_app.picking.stop import StopToken
from evg_app.trials.scorekeeper import Labeller, Scorekeeper
from evg_app.viewer.desk import Desk

AT_LOOK_RAD = 0.05
"""The arm is out of the camera's way when every joint is this close to the look pose [rad]."""
HOMING_TIMEOUT = 30.0
"""The hand may take this long to home [s]."""


class TableSetter:
    """Implements `picking.context.Rounds`: a person sets the table."""

    def __init__(self, operator: Operator) -> None:
        self._operator = operator

    def prepare(self, round_index: int, seed: int) -> int | None:
        """Ask for the table to be set; how many objects are on it, None when nobody counted."""
        return self._operator.number(f"Round {round_index}: set the table. How many objects? (Enter: not counted)")


@dataclass(frozen=True)
class Table:
    """Who sets the table and judges: the procedure, where the operator's labels are kept, who sits at the view."""

    procedure: Procedure
    label: Labeller
    desk: Desk | None = None


def _at_table(ctx: Context, operator: Operator, table: Table) -> tuple[Context, Rounds]:
    """With a protocol the operator is told what to place, and is the referee."""
    if table.procedure.protocol is None:
        return ctx, TableSetter(operator)
    keeper = Scorekeeper(table.procedure.protocol, operator.answer, say, table.label)
    return replace(ctx, referee=keeper, sink=fan_out(ctx.sink, keeper)), keeper


def speed_of(args: argparse.Namespace, robot: RobotConfig) -> float:
    """The share of the configured speed for this run; `--confirm-speed` is remembered for the robot."""
    if args.confirm_speed is not None:
        path = confirm_speed(robot.name, args.confirm_speed, args.config_dir)
        say(f"speed {args.confirm_speed:g} of the configured limits, remembered in {path}")
        return float(args.confirm_speed)
    share = confirmed_speed(robot.name, args.config_dir)
    say(f"speed {share:g} of the configured limits; change it with --confirm-speed X")
    return share


def run_real(
    args: argparse.Namespace,
    robot: RobotConfig,
    camera: CameraConfig,
    calibration: Calibration,
    planner: Planner,
    motion: MotionPlanner,
    sink: Sink,
    folder: Path,
    share: float,
    table: Table,
) -> RunResult:
    """Connect, check, and run the rounds at a share of the configured speed.

    Raises:
        EvgError: refusal or hardware.
    """
    stop = StopToken()
    operator = Operator(stop, table.desk)
    wishes = Wishes(args.driver or robot.driver, args.camera, args.host, args.serial, args.step, args.dry_run)
    lab = build_real_lab(robot, camera, calibration, wishes, motion.kinematics, operator.confirm, sink)
    say("limits, guard and stops of evg-app are software and NOT a safety function: keep your emergency stop at hand")
    with _connected(lab, args.stop_file or folder / "STOP", stop, sink):
        ctx = context_of(lab, planner, motion, share, stop, fan_out(lab.arm.listen, sink))
        check_camera(lab, ctx)
        ctx, rounds = _at_table(replace(ctx, supervisor=supervisor(args, table.desk, operator)), operator, table)
        if args.dry_run:
            return dry_run(ctx, rounds, args.seeds, args.rounds, lab.arm.check)
        _home_if_needed(lab)
        return run_rounds(ctx, rounds, args.seeds, args.rounds, table.procedure.done)


@contextmanager
def _connected(lab: RealLab, file: Path, stop: StopToken, sink: Sink) -> Iterator[None]:
    """Devices entered, stops listened to; at the end what the connection was like."""
    with ExitStack() as stack:
        stack.enter_context(entered(lab, sink))
        stack.enter_context(lab.stop_topic(lambda: stop_now(stop)))
        stack.enter_context(stop_file(file, stop))
        say(f"to stop at once: Ctrl-C twice, or: touch {file}")
        try:
            yield
        finally:
            report = lab.after()
            if report:
                sink(Warned("link", report))


def context_of(
    lab: RealLab, planner: Planner, motion: MotionPlanner, share: float, stop: StopToken, sink: Sink
) -> Context:
    """What the loop needs of a lab whose devices are entered."""
    perception = TablePerception(
        lab.robot.T_base_task.matrix(),
        lab.T_base_cam,
        motion.kinematics.link_primitives,
        lab.camera_config.table_is_ruler,
        lab.camera_config.min_valid_ratio,
    )
    return Context(
        devices=Devices(lab.camera, lab.arm, lab.gripper, lab.clock),
        perception=perception,
        planner=planner,
        motion=SlowedMotion(PlannedMotion(motion), lambda path: slowed(path, share)),
        robot=lab.robot,
        camera=lab.camera_config,
        sink=sink,
        stop=stop,
        settings=Settings(close_after_contact=lab.robot.contact.then == "close"),
    )


def check_camera(lab: RealLab, ctx: Context) -> None:
    """Show and log how good the depth is; with the arm out of the way, refuse when it is too bad.

    Raises:
        Refused: with the numbers and the advice.
        DeviceTimeout: no frame came.
    """
    away = abs(lab.arm.state().q - lab.robot.look_q_rad).max() < AT_LOOK_RAD
    health = check_depth(ctx, refuse=away)
    if health.advice:
        say(f"camera: {health.advice} (the arm is not at its look pose and may be in the way)")


def _home_if_needed(lab: RealLab) -> None:
    """A hand that was never homed does not know its widest opening."""
    if getattr(lab.gripper, "needs_homing", False):
        say("the hand was not homed since power-on: homing it now")
        result = lab.gripper.homing(HOMING_TIMEOUT)
        if not result.success:
            raise HardwareError(f"homing the hand failed: {result.message} Look at Desk, then run the command again")
