"""`evg-app calibrate verify`: move to fresh poses and measure a stored result again.

Example: `evg-app calibrate verify`, or with the stand-in:
`evg-app calibrate verify --sim --seed 3 --result runs/calibrate-.../result.yaml`
"""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from evg_app.cli import calibrate_bench
from evg_app.cli.console import hushed, say
from evg_app.cli.trials.common import write_json_file
from evg_app.config.calibration import Calibration, newest_calibration
from evg_app.config.files import read
from evg_app.errors import BadInput

if TYPE_CHECKING:
    from evg_app.handeye.collect import Bench


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]", devices: argparse.ArgumentParser) -> None:
    """Declare `calibrate verify`; `devices` declares what it shares with `calibrate`."""
    parser = verbs.add_parser(
        "verify", help="measure a stored result again on fresh poses", description=__doc__, parents=[devices]
    )
    parser.add_argument("--result", type=Path, metavar="FILE", help="(default: the newest in calibration/)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure and say. Returns 0 for go and warn, 3 for refuse.

    Raises:
        EvgError: no result, a bad name or file, or a device failed.
    """
    with hushed():
        from evg_app.handeye.check import check, fresh_samples
    path = args.result
    if path is None:
        result, path = newest_calibration(args.robot, args.camera, args.config_dir)
    elif not path.is_file():
        raise BadInput(f"--result {path} does not exist; name a file that `evg-app calibrate` wrote")
    else:
        result = read(path, Calibration)
    args.board = result.board
    with _bench(args, result) as bench:
        begin = bench.clock.now()
        session = fresh_samples(bench, result, args.seed + 1)
        seconds = bench.clock.now() - begin
    found = check(session, result)
    write_json_file(args.json, {**asdict(found), "result": str(path), "mode": result.mode, "seconds": seconds})
    say(f"{len(session.samples)} poses in {seconds:.0f} s")
    if found.mm is not None:
        say(f"{found.verdict.upper()}  {found.mm:.2f} mm, {found.deg:.3f} deg on {found.samples} fresh poses ({path})")
    if found.reason:
        say(f"  - {found.reason}")
    return 3 if found.verdict == "refuse" else 0


@contextmanager
def _bench(args: argparse.Namespace, result: Calibration) -> "Iterator[Bench]":
    """The stand-in's or the real devices, entered; samples are not kept."""
    if args.sim:
        yield calibrate_bench.simulated(args, result.mode, lambda sample, frame: None).bench
        return
    with calibrate_bench.real(args, result.mode, lambda sample, frame: None) as bench:
        yield bench
