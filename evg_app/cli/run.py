"""`evg-app run`: pick objects until the table is clear.

Example: `evg-app run --sim --scene pile --rounds 10 --seed 0 --json out.json`
"""

import argparse
import json
import os
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from evg_app.cli import hardware_arguments, live_view, protocols
from evg_app.cli.arguments import count, seeds
from evg_app.cli.console import hushed, say
from evg_app.config.files import load_robot, load_world
from evg_app.config.models import CameraConfig, RobotConfig, WorldConfig
from evg_app.config.protocol import ProtocolConfig
from evg_app.errors import BadInput

DEFAULT_SCENE = "packed"
PLANNER_THREADS = 1
"""Threads of the network: more gain little and stall for seconds when another process holds a core."""


def _speed(text: str) -> float:
    value = float(text)
    if not 0.01 <= value <= 1000:
        raise argparse.ArgumentTypeError("must be between 0.01 and 1000 (times real time)")
    return value


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("run", help="pick objects off the table and log every trial", description=__doc__)
    parser.add_argument("--sim", action="store_true", help="PyBullet stands in for arm, gripper and camera")
    parser.add_argument("--robot", default="panda", metavar="NAME", help="robot_configs/NAME.yaml (default: panda)")
    parser.add_argument(
        "--camera",
        default="d435i",
        metavar="NAME",
        help="robot_configs/NAME.yaml (default: d435i), or replay/FILE.db3 or replay/RUN_FOLDER",
    )
    parser.add_argument(
        "--model",
        default="equiigd",
        metavar="NAME",
        help="equiigd, equigiga, giga, vgn, antipodal or random (default: equiigd)",
    )
    parser.add_argument(
        "--weights", metavar="FILE", help="a .safetensors file or a shipped name (default: the model's)"
    )
    parser.add_argument("--device", default="cpu", help="where the network runs: cpu or cuda")
    parser.add_argument("--rounds", type=count, default=1, metavar="N", help="rounds (default: 1)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--seed", type=seeds, dest="seeds", default=(0,), metavar="S", help="of scenes, noise, policy")
    which.add_argument("--seeds", type=seeds, metavar="S,S,...", help="several seeds; --rounds counts for each")
    parser.add_argument("--run-dir", type=Path, metavar="DIR", help="run folder (default: runs/<date>-<id>)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the summary here")
    parser.add_argument(
        "--config-dir", type=Path, metavar="DIR", help="your own robot_configs/ and sim/, looked up first"
    )
    sim = parser.add_argument_group("simulation")
    sim.add_argument("--scene", default=DEFAULT_SCENE, metavar="NAME", help="sim/worlds/NAME.yaml (default: packed)")
    sim.add_argument(
        "--objects", type=Path, metavar="DIR", help="URDFs in VGN's layout instead of the built-in objects"
    )
    sim.add_argument("--gui", action="store_true", help="show PyBullet's window")
    sim.add_argument(
        "--speed", type=_speed, metavar="X", help="pace at X times real time (default: as fast as it goes)"
    )
    hardware_arguments.add_arguments(parser)
    protocols.add_arguments(parser)
    live_view.add_arguments(parser)
    parser.set_defaults(run=run)


def _json_target(path: Path | None) -> None:
    """Refuse an unwritable --json before anything moves."""
    if path is None:
        return
    if path.is_dir() or not path.parent.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK):
        raise BadInput(
            f"--json {path} cannot be written. Name a file in a folder that exists and that you may write to"
        )


def snapshot(args: argparse.Namespace, *models: RobotConfig | CameraConfig | WorldConfig) -> dict[str, Any]:
    """Everything that configures a run, for the log."""
    given = {key: str(value) if isinstance(value, Path) else value for key, value in vars(args).items() if key != "run"}
    names = ("robot", "camera", "world")
    return {"arguments": given} | {n: m.model_dump(mode="json") for n, m in zip(names, models, strict=False)}


def run(args: argparse.Namespace) -> int:
    """Run rounds. Returns the exit code.

    Raises:
        EvgError: bad input, refusal or hardware, each with its exit code.
    """
    robot = load_robot(args.robot, args.config_dir)
    camera = hardware_arguments.camera_config_of(args.camera, args.config_dir)
    _json_target(args.json)
    protocol = protocols.apply_protocol(args)
    if not args.sim:
        return _on_hardware(args, robot, camera, protocol)
    hardware_arguments.refuse_with_sim(args)
    world = protocols.world_of(load_world(args.scene, args.config_dir), protocol)
    return _simulate(args, robot, camera, world, protocol)


def _on_hardware(
    args: argparse.Namespace, robot: RobotConfig, camera: CameraConfig, protocol: ProtocolConfig | None
) -> int:
    calibration = hardware_arguments.require_ready(robot, camera, args.config_dir)
    import torch

    with hushed():
        from evg_app.cli.real_run import Table, run_real, speed_of
    from evg_app.cli.progress import Progress
    from evg_app.events import fan_out
    from evg_app.grasping.load import load_planner
    from evg_app.motion.feasibility import MotionPlanner
    from evg_app.trials.folder import default_name
    from evg_app.trials.recorder import Recorder

    torch.set_num_threads(PLANNER_THREADS)
    planner, motion = load_planner(args.model, args.weights, args.device), MotionPlanner(robot)
    folder = args.run_dir or default_name()
    share = speed_of(args, robot)
    config = snapshot(args, robot, camera) | protocols.facts(protocol)
    config |= {"calibration": calibration.model_dump(mode="json"), "speed_share": share}
    procedure = protocols.procedure(args, protocol, folder, config, planner)
    with (
        live_view.live_view(args, robot, folder) as seen,
        Recorder(folder, config, resume=args.resume, placement=procedure.placement) as recorder,
    ):
        sink = fan_out(recorder, Progress(), seen.sink)
        table = Table(procedure, recorder.store.label, seen.desk)
        result = run_real(args, robot, camera, calibration, planner, motion, sink, folder, share, table)
    _report(folder, args.json)
    if result.error is not None:
        raise result.error
    return result.exit_code


def _simulate(
    args: argparse.Namespace,
    robot: RobotConfig,
    camera: CameraConfig,
    world_config: WorldConfig,
    protocol: ProtocolConfig | None,
) -> int:
    import torch

    with hushed():
        from evg_app.cli.lab import build_lab, loop_context
    from evg_app.cli.operator import Operator, supervisor
    from evg_app.cli.progress import Progress
    from evg_app.events import fan_out
    from evg_app.grasping.load import load_planner
    from evg_app.motion.feasibility import MotionPlanner
    from evg_app.picking.run import run_rounds
    from evg_app.trials.film import Film
    from evg_app.trials.folder import default_name
    from evg_app.trials.recorder import Recorder

    torch.set_num_threads(PLANNER_THREADS)
    planner, motion = load_planner(args.model, args.weights, args.device), MotionPlanner(robot)
    lab = build_lab(robot, camera, world_config, args.objects, args.gui, args.speed)
    film, folder = Film(), args.run_dir or default_name()
    with ExitStack() as stack:
        stack.callback(lab.world.close)
        seen = stack.enter_context(live_view.live_view(args, robot, folder))
        config = snapshot(args, robot, camera, world_config) | protocols.facts(protocol)
        procedure = protocols.procedure(args, protocol, folder, config, planner)
        recorder = Recorder(folder, config, None, film, False, args.resume, procedure.placement)
        stack.enter_context(recorder)
        for device in (lab.camera, lab.arm, lab.gripper):
            stack.enter_context(device)
        ctx = loop_context(lab, robot, camera, planner, motion, fan_out(recorder, Progress(), seen.sink), film)
        ctx = replace(ctx, supervisor=supervisor(args, seen.desk, Operator(ctx.stop)))
        result = run_rounds(ctx, lab.rounds, args.seeds, args.rounds, procedure.done)
    _report(folder, args.json)
    if result.error is not None:
        raise result.error
    return result.exit_code


def _report(folder: Path, target: Path | None) -> None:
    """Write the JSON, and say what came out."""
    from evg_app.trials.report import report
    from evg_app.trials.summary import summary

    facts = summary(folder)
    if target is not None:
        target.write_text(json.dumps(facts, indent=2) + "\n")
    say(report(facts))
    say(f"run folder: {folder}")
