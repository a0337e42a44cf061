"""`evg-app benchmark clutter`: clear simulated tables by the published protocol.

Example: `evg-app benchmark clutter --scene pile --objects DIR --rounds 100 --seeds 0,1 --json pile.json`
"""

import argparse
from pathlib import Path
from typing import Any

from evg_app.cli.arguments import cores, count, seeds
from evg_app.cli.console import hushed, say
from evg_app.cli.trials import write_json_file
from evg_app.trials.statistics import rate

SCENES = ("packed", "pile", "adversarial")
NOISES = ("gamma", "field", "gaussian", "none")
VIEWS = ("side", "random", "random-orbitgrasp", "random-igd")
MODELS = "equiigd, equigiga, equiigd-dense, equigiga-dense, giga, vgn, antipodal or random (default: equiigd)"


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("clutter", help="play rounds with a free-flying gripper", description=__doc__)
    parser.add_argument("--scene", choices=SCENES, default="packed", help="(default: packed)")
    parser.add_argument("--view", choices=VIEWS, default="side", help="fixed side view, or random (ICGNet's recipe)")
    parser.add_argument("--noise", choices=NOISES, default="gamma", help="depth noise (default: gamma)")
    parser.add_argument("--objects", type=Path, metavar="DIR", help="URDFs in VGN's layout (default: built-in test)")
    parser.add_argument(
        "--split", choices=("all", "train", "validation"), default="all", help="of the objects, by name (default: all)"
    )
    parser.add_argument("--count", type=count, default=5, metavar="N", help="objects asked for (default: 5)")
    parser.add_argument("--rounds", type=count, default=100, metavar="N", help="of each seed (default: 100)")
    parser.add_argument("--seeds", type=seeds, default=(0,), metavar="S,S,...", help="(default: 0)")
    parser.add_argument("--model", default="equiigd", metavar="NAME", help=MODELS)
    parser.add_argument("--weights", metavar="FILE", help="weights file or shipped name (default: the model's)")
    parser.add_argument("--device", default="cpu", help="where the network runs (default: cpu)")
    parser.add_argument("--camera", choices=("d435i", "giga"), default="d435i", help="the paper's, or GIGA's and VGN's")
    parser.add_argument(
        "--table-ruler", action="store_true", help="scale depth by the known table first (not official)"
    )
    parser.add_argument(
        "--strict", action="store_true", help="rank by the score of untouched approaches, as `run` does on an arm"
    )
    parser.add_argument("--workers", type=count, metavar="N", help="processes (default: all cores)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result; FILE's .rounds.jsonl resumes")
    parser.set_defaults(run=clutter)


def clutter(args: argparse.Namespace) -> int:
    """Play the rounds that are missing, and say what came out. Returns 0.

    Raises:
        EvgError: a bad name, folder, file or value.
    """
    with hushed():
        from evg_app.benchmark.clutter.config import BenchmarkConfig
        from evg_app.benchmark.clutter.rounds import RoundResult
        from evg_app.benchmark.clutter.run import benchmark

    config = BenchmarkConfig(
        scene=args.scene,
        view=args.view,
        noise=args.noise,
        model=args.model,
        weights=args.weights,
        device=args.device,
        objects=None if args.objects is None else str(args.objects),
        split=args.split,
        count=args.count,
        camera=args.camera,
        table_ruler=args.table_ruler,
        allow_contact=not args.strict,
    )

    def progress(rows: list[RoundResult], wanted: int) -> None:
        """A line for the round that has just ended."""
        last = rows[-1]
        k, n, objects = (sum(getattr(row, name) for row in rows) for name in ("successes", "attempts", "objects"))
        say(
            f"{len(rows)}/{wanted}  seed {last.seed} round {last.round}: {last.successes}/{last.attempts} of "
            f"{last.objects} objects, {last.end}   so far GSR {k}/{n}, DR {k}/{objects}"
        )

    facts = benchmark(config, args.seeds, args.rounds, args.workers or cores(), args.json, progress)
    if args.json is not None:
        write_json_file(args.json, facts)
    _report(facts)
    return 0


def _report(facts: dict[str, Any]) -> None:
    low, high = (100 * bound for bound in facts["dr_ci"])
    say(f"{facts['model']} {facts['weights_sha256'][:12]}: {facts['rounds']} rounds, seeds {facts['seeds']}")
    say(f"GSR  {rate(facts['successes'], facts['attempts'])}   (Wilson)")
    cleared = f"{facts['successes']}/{facts['objects']} = {100 * facts['dr']:.1f} %"
    say(f"DR   {cleared} [{low:.1f}, {high:.1f}]   (bootstrap)")
    for name in ("ends", "outcomes"):
        say(f"{name:<8} " + ", ".join(f"{word} {count}" for word, count in facts[name].items()))
    if facts["plan_ms_median"] is not None:
        say(f"plan     {facts['plan_ms_median']:.0f} ms (median)")
