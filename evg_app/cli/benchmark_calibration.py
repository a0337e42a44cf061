"""`evg-app benchmark calibration`: simulated calibrations against their truth, good ones and deliberately bad ones.

Example: `evg-app benchmark calibration --good 50 --bad 5 --json calibration.json`
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evg_app.cli.arguments import count
from evg_app.cli.console import hushed, say
from evg_app.cli.trials.common import write_json_file
from evg_app.trials.statistics import rate

if TYPE_CHECKING:
    from evg_app.benchmark.calibration.units import SessionRow


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the benchmark."""
    parser = verbs.add_parser("calibration", help="hand-eye calibrations against their truth", description=__doc__)
    parser.add_argument("--good", type=int, default=50, metavar="N", help="good sessions of each mode (default: 50)")
    parser.add_argument("--bad", type=int, default=5, metavar="N", help="bad ones of each mode and cause (default: 5)")
    parser.add_argument("--first-seed", type=int, default=0, metavar="S", help="(default: 0)")
    parser.add_argument("--samples", type=count, default=24, metavar="N", help="stops of each session (default: 24)")
    parser.add_argument("--board", default="charuco_a4", metavar="NAME", help="calibration/boards/NAME.yaml")
    parser.add_argument("--workers", type=count, default=1, metavar="N", help="processes that collect (default: 1)")
    parser.add_argument("--json", type=Path, required=True, metavar="FILE", help="FILE's .sessions.jsonl resumes")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Play what is missing and say what came out. Returns 0.

    Raises:
        EvgError: a bad name, file or value.
    """
    with hushed():
        from evg_app.benchmark.calibration.run import play, units
        from evg_app.benchmark.calibration.units import Study

    def progress(row: "SessionRow", done: int, wanted: int) -> None:
        """One line for each finished session."""
        f = row.facts
        true, bound = ("-" if f[key] is None else f"{f[key]:.2f} mm" for key in ("true_mm", "bound_mm"))
        causes = ", ".join(f["causes"]) or "nothing found"
        say(f"{done}/{wanted}  {row.kind} {row.mode} {row.seed}: {f['verdict']}, true {true}, bound {bound}; {causes}")

    wanted = units(args.good, args.bad, args.first_seed)
    facts = play(Study(args.board, args.samples), wanted, args.workers, args.json, progress)
    write_json_file(args.json, facts)
    _report(facts)
    return 0


def _report(facts: dict[str, Any]) -> None:
    """The summary as text."""
    for mode, found in facts["good"].items():
        below = found["true_below_bound"]
        say(f"{mode}: {found['sessions']} sessions, verdicts {found['verdicts']}")
        for key in ("true_mm", "true_deg", "bound_mm", "heldout_mm", "heldout_deg"):
            say(f"  {key:<12} " + "  ".join(f"{name} {found[key][name]:.3f}" for name in ("median", "p95", "max")))
        say(f"  true below bound {rate(below['k'], below['n'])}")
        for name, numbers in found["plain"].items():
            mm = numbers["true_mm"]
            text = "no result" if mm["n"] == 0 else f"median {mm['median']:.2f} mm  p95 {mm['p95']:.2f} mm"
            say(f"  plain {name:<22} {text}  failed {numbers['failed']}")
    for kind, found in facts["bad"].items():
        k = found["named_and_harmless"]
        say(f"{kind:<13} refused or repaired, cause named {rate(k['k'], k['n'])}  refused {found['refused']}")
    if facts["bad_all"]:
        k = facts["bad_all"]["named_and_harmless"]
        say(f"all bad       refused or repaired, cause named {rate(k['k'], k['n'])}")
