"""`evg-app benchmark latency`: from a depth image to ranked grasps, against the limit of the machine.

Example: `evg-app benchmark latency --frames 200 --threads 1,2 --json latency.json`
"""

import argparse
from pathlib import Path
from typing import Any

from evg_app.cli.arguments import count
from evg_app.cli.console import hushed, say
from evg_app.cli.trials.common import write_json_file
from evg_app.errors import BadInput
from evg_app.trials.statistics import rate


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("latency", help="time from depth image to grasps, stage by stage", description=__doc__)
    parser.add_argument("--frames", type=count, default=200, metavar="N", help="depth images (default: 200)")
    parser.add_argument("--threads", type=counts, default=(1, 2), metavar="N,N", help="numbers of threads (1,2)")
    parser.add_argument("--rows", type=words, metavar="NAME,NAME", help="of the table (default: all)")
    parser.add_argument(
        "--weights", action="append", default=[], metavar="MODEL=FILE", help="instead of shipped or random ones"
    )
    parser.add_argument("--device", default="cpu", help="where the networks run (default: cpu)")
    parser.add_argument(
        "--agreement", type=count, metavar="N", help="compare fast and dense on N frames instead of timing; resumes"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result")
    parser.set_defaults(run=run)


def counts(text: str) -> tuple[int, ...]:
    """Whole numbers from 1 up with commas between."""
    return tuple(count(word) for word in text.split(","))


def words(text: str) -> tuple[str, ...]:
    """Words with commas between."""
    return tuple(text.split(","))


def run(args: argparse.Namespace) -> int:
    """Time the rows, or compare fast and dense, and say what came out. Returns 0.

    Raises:
        EvgError: a bad name, file or value.
    """
    with hushed():
        from evg_app.benchmark.latency.rendering import make_frames
        from evg_app.benchmark.latency.subjects import NAMES, model_of
    names = args.rows or NAMES
    weights = dict(_pair(text) for text in args.weights)
    unknown = [n for n in names if n not in NAMES] + [m for m in weights if m not in {model_of(n) for n in NAMES}]
    if unknown:
        raise BadInput(f"there is no row {', '.join(unknown)}; known: {', '.join(NAMES)}")
    make_frames(args.agreement or args.frames, _made)
    if args.agreement:
        return _agreement(args, weights)
    from evg_app.benchmark.latency.run import table

    facts = table(names, args.threads, args.frames, weights, args.device, _say_row)
    _say_floor(facts)
    if args.json is not None:
        write_json_file(args.json, facts)
    return 0


def _agreement(args: argparse.Namespace, weights: dict[str, str]) -> int:
    """Compare the best grasps of fast and dense plans. Returns 0."""
    from evg_app.benchmark.latency.agreement import compare

    facts = compare(args.agreement, weights.get("equiigd"), args.json, lambda done, wanted: say(f"{done}/{wanted}"))
    say(f"the best grasp agrees: {rate(facts['agree'], facts['frames'])}   (Wilson)")
    say(f"  same place and approach {facts['same_place']}, else score within {facts['score_tolerance']}")
    if args.json is not None:
        write_json_file(args.json, facts)
    return 0


def _pair(text: str) -> tuple[str, str]:
    """MODEL=FILE.

    Raises:
        BadInput: it is not of that form.
    """
    model, equals, file = text.partition("=")
    if not equals or not file:
        raise BadInput(f"--weights takes MODEL=FILE, e.g. giga=giga_pile.pt, not '{text}'")
    return model, file


def _made(done: int, wanted: int) -> None:
    """How many frames are there."""
    if done == 1 or done % 50 == 0 or done == wanted:
        say(f"frame {done}/{wanted} made")


def _say_row(row: dict[str, Any]) -> None:
    """A row's times."""
    stages = "  ".join(f"{name} {values['median_ms']:.1f}" for name, values in row["stages"].items())
    note = "  random weights" if row["random_weights"] else ""
    say(
        f"{row['name']:<14} {row['threads']} thr  median {row['median_ms']:7.1f}  p95 {row['p95_ms']:7.1f}  "
        f"p99 {row['p99_ms']:7.1f} ms  {row['rss_mb']:5.0f} MB  first {row['first_grasp_s']:.1f} s   {stages}{note}"
    )


def _say_floor(facts: dict[str, Any]) -> None:
    """What the machine could do, and how far each row is from it."""
    for threads, gflops in facts["machine_gflops_by_threads"].items():
        say(f"machine, {threads} threads: {gflops:.0f} GFLOP/s")
    if facts["encoder_floor_ms"] is not None:
        say(f"encoder: {facts['encoder_gflop']:.2f} GFLOP, at least {facts['encoder_floor_ms']:.1f} ms on the machine")
    for row in facts["rows"]:
        if "over_floor" in row:
            say(f"  {row['name']:<14} {row['threads']} thr: {row['over_floor']:.1f} x its floor {row['floor_ms']} ms")
