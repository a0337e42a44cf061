"""`evg-app benchmark`: what the program claims, measured; and two results compared.

Example: `evg-app benchmark compare before.json after.json`
"""

import argparse
from pathlib import Path

from evg_app.cli import benchmark_calibration, benchmark_clutter, benchmark_latency, benchmark_motion
from evg_app.cli.console import hushed, say
from evg_app.cli.trials import write_json_file

BENCHMARKS = (benchmark_calibration, benchmark_clutter, benchmark_latency, benchmark_motion)


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb with one verb for each benchmark, and `compare`."""
    top = verbs.add_parser("benchmark", help="measure what the program claims; compare results")
    inner = top.add_subparsers(dest="benchmark_verb", required=True, metavar="VERB")
    for benchmark in BENCHMARKS:
        benchmark.add_parser(inner)
    pair = inner.add_parser("compare", help="two results of `clutter` paired by round: difference with 95 %% interval")
    pair.add_argument("first", type=Path, metavar="A.json")
    pair.add_argument("second", type=Path, metavar="B.json")
    pair.add_argument("--json", type=Path, metavar="FILE", help="also write the numbers")
    pair.set_defaults(run=compare)


def compare(args: argparse.Namespace) -> int:
    """Say how two results differ. Returns 0.

    Raises:
        BadInput: a file is not a result, or the two cannot be paired.
    """
    with hushed():
        from evg_app.benchmark.clutter.compare import compare as paired_by_round

    facts = paired_by_round(args.first, args.second)
    say(f"{facts['rounds']} common rounds; A {facts['model_a']} ({args.first}), B {facts['model_b']} ({args.second})")
    for name in ("gsr", "dr"):
        a, b, difference = (100 * facts[name][key] for key in ("a", "b", "difference"))
        low, high = (100 * bound for bound in facts[name]["ci"])
        say(f"{name.upper():<4} A {a:.1f} %  B {b:.1f} %  B - A {difference:+.1f} [{low:+.1f}, {high:+.1f}]")
    if args.json is not None:
        write_json_file(args.json, facts)
    return 0
