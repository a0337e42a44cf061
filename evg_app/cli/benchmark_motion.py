"""`evg-app benchmark motion`: reachability, contacts and limits of whole picks in seeded scenes.

Example: `evg-app benchmark motion --scenes 300 --seed 0 --json motion.json` (the same command goes on where it stopped)
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evg_app.benchmark.motion.row import TIMES
from evg_app.cli.arguments import cores, count
from evg_app.cli.console import hushed, say
from evg_app.cli.trials.common import write_json_file
from evg_app.trials.statistics import rate

if TYPE_CHECKING:
    from evg_app.benchmark.motion.row import SceneRow


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("motion", help="reachability, contacts and limits of whole picks", description=__doc__)
    parser.add_argument("--scenes", type=count, default=300, metavar="N", help="a third each packed, pile, adversarial")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of scenes, grasps and noise (default: 0)")
    parser.add_argument("--jobs", type=count, metavar="N", help="processes (default: all cores)")
    parser.add_argument("--robot", default="panda", metavar="NAME", help="robot_configs/NAME.yaml (default: panda)")
    parser.add_argument("--camera", default="d435i", metavar="NAME", help="robot_configs/NAME.yaml (default: d435i)")
    parser.add_argument("--config-dir", type=Path, metavar="DIR", help="your own robot_configs/ and sim/, first")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result; FILE's .scenes.jsonl resumes")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the scenes that are missing, and say what came out. Returns 0.

    Raises:
        EvgError: a bad name, folder, file or value.
    """
    with hushed():
        from evg_app.benchmark.motion.config import MotionBenchmark
        from evg_app.benchmark.motion.run import benchmark
    folder = None if args.config_dir is None else str(args.config_dir)
    config = MotionBenchmark(robot=args.robot, camera=args.camera, config_dir=folder)
    facts = benchmark(config, args.seed, args.scenes, args.jobs or cores(), args.json, _progress)
    write_json_file(args.json, facts)
    _report(facts)
    return 0


def _progress(rows: "list[SceneRow]", wanted: int) -> None:
    last = rows[-1]
    done = [cycle for row in rows for cycle in row.cycles if cycle.executed]
    touched = sum(bool(cycle.contacts) for cycle in last.cycles)
    say(
        f"{len(rows)}/{wanted}  scene {last.number} ({last.kind}): {len(last.cycles)} picks, {touched} with contact"
        f"   so far {len(done)} executed"
    )


def _report(facts: dict[str, Any]) -> None:
    say(f"{facts['scenes']} scenes, seed {facts['seed']}, unknown space {facts['unknown_space']}")
    say(f"reachable grasps found   {rate(facts['reachable_found'], facts['reachable_total'])}")
    say(f"    made a whole pick of   {rate(facts['reachable_picked'], facts['reachable_total'])}")
    if facts["reachable_not_picked"]:
        say("    the others: " + ", ".join(f"{word} {n}" for word, n in facts["reachable_not_picked"].items()))
    for arm, numbers in facts["arms"].items():
        say(f"touched before closing, {arm}: {rate(numbers['contacts'], numbers['executed'])}")
        for pair, n in list(numbers["touched"].items())[:5]:
            say(f"    {pair}: {n}")
    say(f"limit violations         {facts['limit_violations']}")
    recheck = facts["recheck"]
    say(f"look before approach     false alarms {rate(recheck['false_alarms'], recheck['looks'])}")
    say(f"    target moved by 3 cm is noticed in {rate(recheck['noticed'], recheck['looks'])}")
    say("CPU times, median/p99 ms " + ", ".join(f"{t} {facts[t + '_median']}/{facts[t + '_p99']}" for t in TIMES))
