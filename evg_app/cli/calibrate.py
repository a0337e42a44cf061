"""`evg-app calibrate`: where the camera stands, to how many millimetres, and whether that is good enough.

Example: `evg-app calibrate --sim --mode eye-to-hand --seed 3 --json out.json`
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evg_app.cli import calibrate_bench, calibrate_board, calibrate_verify
from evg_app.cli.arguments import count, port
from evg_app.cli.console import hushed, say
from evg_app.cli.trials.common import write_json_file
from evg_app.config.calibration import FOLDER, MODES, save_calibration, write_calibration
from evg_app.errors import BadInput, EvgError
from evg_app.types import Frame

if TYPE_CHECKING:
    from evg_app.handeye.collect import OnSample
    from evg_app.handeye.live import LivePicture
    from evg_app.handeye.sample import Sample
    from evg_app.handeye.store import RunFolder

SAMPLES = 24
RESULT, FACTS, REPORT = "result.yaml", "facts.json", "report.html"
VIEW_PORT = 8080
SOLVE_TIMEOUT = 600.0
"""[s]."""


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb with its verbs `board` and `verify`."""
    parser = verbs.add_parser(
        "calibrate",
        help="find where the camera stands, with its error in millimetres",
        description=__doc__,
        parents=[_devices()],
    )
    parser.add_argument("--mode", choices=MODES, help="camera beside the table (eye-to-hand) or on the hand")
    parser.add_argument("--board", default="charuco_a4", metavar="NAME", help="calibration/boards/NAME.yaml")
    parser.add_argument("--samples", type=count, default=SAMPLES, metavar="N", help=f"stops (default: {SAMPLES})")
    parser.add_argument("--manual", action="store_true", help="guide the arm by hand; Enter takes a sample")
    parser.add_argument("--from", dest="source", type=Path, metavar="RUN", help="solve the samples of a folder again")
    parser.add_argument("--run-dir", type=Path, metavar="DIR", help="where samples and report go")
    parser.add_argument("--force", action="store_true", help="keep a refused result; the file says so")
    parser.add_argument("--view", action="store_true", help="show what is detected in the browser, live")
    parser.add_argument("--view-port", type=port, default=VIEW_PORT, metavar="P", help=f"(default: {VIEW_PORT})")
    parser.set_defaults(run=run)
    inner = parser.add_subparsers(dest="calibrate_verb", metavar="VERB", title="other verbs")
    calibrate_board.add_parser(inner)
    calibrate_verify.add_parser(inner, _devices())


def _devices() -> argparse.ArgumentParser:
    """What `calibrate` and `calibrate verify` share."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--sim", action="store_true", help="a stand-in moves, renders the board and judges the result")
    parser.add_argument("--robot", default="panda", metavar="NAME", help="robot_configs/NAME.yaml (default: panda)")
    parser.add_argument("--camera", default="d435i", metavar="NAME", help="robot_configs/NAME.yaml (default: d435i)")
    parser.add_argument("--driver", choices=("ros2", "fci"), help="how to reach the arm (default: the robot's config)")
    parser.add_argument("--host", default="", metavar="ADDRESS", help="the arm's address for --driver fci")
    parser.add_argument("--serial", default="", metavar="S", help="which of several cameras")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the views, and of the stand-in")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the numbers")
    parser.add_argument("--config-dir", type=Path, metavar="DIR", help="your own robot_configs/ and calibration/")
    return parser


def run(args: argparse.Namespace) -> int:
    """Calibrate. Returns 0 for go and warn, 3 for refuse.

    Raises:
        EvgError: a bad name, file or value, or a device failed.
    """
    if args.source is not None:
        return _solve(args)
    if args.mode is None:
        raise BadInput("say where the camera is: --mode eye-to-hand (beside the table) or --mode eye-in-hand")
    if args.sim and args.manual:
        raise BadInput("nobody can guide the stand-in by hand: leave out --manual, or --sim")
    return _simulate(args) if args.sim else _on_robot(args)


def _simulate(args: argparse.Namespace) -> int:
    """Collect with the stand-in, solve in a process that is given the samples alone, then judge."""
    with hushed():
        from evg_app.handeye.collect import collect
        from evg_app.handeye.standin.judge import judged
    folder, live = _folder(args, simulated=True)
    lab = calibrate_bench.simulated(args, args.mode, _keeps(folder, live))
    with _shown(args, folder):
        folder.finish(collect(lab.bench, args.samples, args.seed))
    facts = _solve_elsewhere(folder.path, args.force)
    facts = judged({**facts, "seed": args.seed}, lab.truth, lab.bench.motion.kinematics)
    write_json_file(args.json, facts)
    if facts["true_mm"] is not None:
        say(f"true error {facts['true_mm']:.2f} mm, {facts['true_deg']:.3f} deg (the judge's; the solver never saw it)")
    return 3 if facts["verdict"] == "refuse" and not args.force else 0


def _on_robot(args: argparse.Namespace) -> int:
    """Collect with the real devices, and solve."""
    with hushed():
        from evg_app.handeye.collect import collect
    folder, live = _folder(args, simulated=False)
    with _shown(args, folder), calibrate_bench.real(args, args.mode, _keeps(folder, live)) as bench:
        if args.manual:
            session = calibrate_bench.by_hand(bench, lambda sample, frame: live.show(sample, taken=False))
        else:
            session = collect(bench, args.samples, args.seed)
    folder.finish(session)
    args.source = folder.path
    return _solve(args)


def _folder(args: argparse.Namespace, simulated: bool) -> "tuple[RunFolder, LivePicture]":
    """The run folder, and the picture in it that shows each look."""
    with hushed():
        from evg_app.handeye.live import LivePicture
        from evg_app.handeye.store import RunFolder, default_folder
    folder = RunFolder(args.run_dir or default_folder(), simulated)
    return folder, LivePicture(folder.path)


def _keeps(folder: "RunFolder", live: "LivePicture") -> "OnSample":
    """What is done with each sample: stored, shown, and on a robot said."""

    def keep(sample: "Sample", frame: Frame) -> None:
        """One sample."""
        folder.add(sample, frame)
        live.show(sample)
        if not folder.simulated:
            found = sample.detection
            say(f"sample {sample.number}: {len(found.ids)} corners, {found.problem or 'ok'} (see {live.path})")

    return keep


@contextmanager
def _shown(args: argparse.Namespace, folder: "RunFolder") -> Iterator[None]:
    """With `--view`, the live picture in the browser while inside."""
    if not args.view:
        yield
        return
    with hushed():
        from evg_app.handeye.live_page import LivePage
    with LivePage(folder.path, args.view_port) as page:
        say(f"live view: {page.url}")
        yield


def _solve_elsewhere(folder: Path, force: bool) -> dict[str, Any]:
    """Run `evg-app calibrate --from` as a process of its own.

    Raises:
        EvgError: it failed.
    """
    words = [sys.executable, "-m", "evg_app.cli.main", "calibrate", "--from", str(folder), *(["--force"] * force)]
    done = subprocess.run(words, timeout=SOLVE_TIMEOUT, check=False)
    if done.returncode not in (0, 3):
        raise EvgError(f"solving failed with exit code {done.returncode}; try it alone: {' '.join(words[3:])}")
    facts: dict[str, Any] = json.loads((folder / FACTS).read_text(encoding="utf-8"))
    return facts


def _solve(args: argparse.Namespace) -> int:
    """Solve a folder of samples, write result and report into it, and say what came out."""
    with hushed():
        from evg_app.handeye.report import write_report
        from evg_app.handeye.result import as_calibration, as_facts
        from evg_app.handeye.solve import Solution, solve
        from evg_app.handeye.store import is_simulated, load_session
    folder = args.source
    session = load_session(folder, args.mode)
    solution = solve(session)
    facts = {**as_facts(session, solution), "run": str(folder)}
    refused = solution.verdict == "refuse" and not args.force
    if isinstance(solution, Solution):
        result = as_calibration(session, solution, str(folder), args.force)
        write_calibration(result, folder / RESULT)
        facts["forced"] = result.forced
        if not refused and not is_simulated(folder):
            facts["file"] = str(save_calibration(result, (args.config_dir or Path.cwd()) / FOLDER))
    write_report(session, solution, folder / REPORT)
    write_json_file(folder / FACTS, facts)
    write_json_file(args.json, facts)
    _report(facts, folder)
    return 3 if refused else 0


def _report(facts: dict[str, Any], folder: Path) -> None:
    """The result as text."""
    say(f"{facts['verdict'].upper()}  {facts['mode']}, {facts['samples']} of {facts['taken']} samples used")
    if facts["heldout_mm"] is not None:
        say(f"held-out error {facts['heldout_mm']:.2f} mm, {facts['heldout_deg']:.3f} deg (samples not fitted)")
        say(f"over the workspace at most {facts['bound_mm']:.2f} mm, {facts['bound_deg']:.3f} deg (95 %)")
        say(f"reprojection {facts['reprojection_px']:.2f} px; board {100 * facts['board_scale']:.2f} % of its size")
    for reason in facts["reasons"]:
        say(f"  - {reason}")
    if "file" in facts:
        say(f"written: {facts['file']}")
    say(f"report: {folder / REPORT}")
