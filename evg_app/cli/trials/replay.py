"""`evg-app trials replay`: does the code still compute what was logged, to the bit?

Example: `evg-app trials replay runs/20260101-120000-abcdef --all`
"""

import argparse
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from evg_app.cli.console import hushed, say
from evg_app.cli.trials.common import add_json, add_run, chosen_run, write_json_file
from evg_app.errors import BadInput, WeightsError
from evg_app.trials.provenance import provenance
from evg_app.trials.recorded import RecordedAttempt, RecordedRun, Session
from evg_app.trials.replay import Difference, Pipeline, Replayed, ReplayStage, environment_changes, replay
from evg_app.trials.what_if import WhatIf, what_if

DIFFERENT = 1
"""Exit code when not every attempt is identical."""


def add_parser(verbs: Any) -> None:
    """Add the verb `replay`."""
    parser = verbs.add_parser(
        "replay",
        help="recompute recorded attempts from their depth and compare to the bit",
        description="Recompute perception, planning and feasibility of recorded attempts from the logged depth. "
        "Exit code 0 when every attempt is identical to the bit, 1 when one is not.",
    )
    add_run(parser)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--attempt", metavar="ID", help="one attempt, by the beginning of its id (default: the last)")
    which.add_argument("--all", action="store_true", help="every recorded attempt")
    parser.add_argument("--model", metavar="NAME", help="what another model would have done on the same depth")
    parser.add_argument("--weights", metavar="FILE", help="weights (default: those that the log names)")
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Replay. Returns 0 when all are identical (always 0 with --model), else 1.

    Raises:
        BadInput: there is no such run or attempt, or its configuration cannot be used.
    """
    recorded = RecordedRun(chosen_run(args))
    if not recorded.attempt_ids:
        raise BadInput(f"{recorded.folder} holds no finished attempt with arrays to replay")
    ids = list(recorded.attempt_ids) if args.all else [recorded.find(args.attempt or recorded.attempt_ids[-1])]
    attempts = (recorded.attempt(name) for name in ids)
    if args.model:
        return _other_model(args, recorded, attempts)
    return _same_model(args, recorded, attempts)


def _same_model(args: argparse.Namespace, recorded: RecordedRun, attempts: Iterator[RecordedAttempt]) -> int:
    """Replay with the logged model and say what differs."""
    pipelines: dict[str, Pipeline | WeightsError] = {}
    results = []
    for attempt in attempts:
        session = recorded.sessions[attempt.run_id]
        if attempt.run_id not in pipelines:
            pipelines[attempt.run_id] = _pipeline_or_error(session, session.model, args.weights)
        result = _replayed(attempt, session, pipelines[attempt.run_id])
        results.append(result)
        if not result.identical:
            say(f"{result.attempt_id}: differs first in {result.first}")
            for found in result.differences:
                say(f"    {found.stage}: {found.what}")
    changes = environment_changes(next(iter(recorded.sessions.values())).provenance, provenance())
    say(_verdict(results))
    for change in changes:
        say(f"recorded elsewhere: {change}")
    write_json_file(args.json, _facts(recorded.folder, results, changes))
    return 0 if all(result.identical for result in results) else DIFFERENT


def _replayed(attempt: RecordedAttempt, session: Session, pipeline: Pipeline | WeightsError) -> Replayed:
    """One attempt; weights that cannot be loaded are a difference, too."""
    if isinstance(pipeline, WeightsError):
        return Replayed(attempt.attempt_id, (Difference(ReplayStage.WEIGHTS, str(pipeline)),))
    return replay(attempt, session, pipeline)


def _pipeline_or_error(session: Session, model: str, weights: str | None) -> Pipeline | WeightsError:
    """The code under replay, or why there are no such weights."""
    try:
        return _pipeline(session, model, weights)
    except WeightsError as error:
        return error


def _pipeline(session: Session, model: str, weights: str | None) -> Pipeline:
    """The code under replay with a model."""
    import torch

    from evg_app.cli.run import PLANNER_THREADS

    with hushed():
        from evg_app.cli.trials.playback import Playback
        from evg_app.grasping.load import load_planner
    torch.set_num_threads(PLANNER_THREADS)
    given = session.config.get("arguments", {})
    if weights is None and model == session.model:
        weights = given.get("weights")
    return Playback(session.config, load_planner(model, weights, given.get("device", "cpu")))


def _verdict(results: list[Replayed]) -> str:
    """How many are identical, and where the others differ first."""
    same = sum(result.identical for result in results)
    text = f"{same} of {len(results)} attempts identical to the bit"
    stages = Counter(str(result.first) for result in results if result.first is not None)
    return text + (f"; first difference: {', '.join(f'{s} {n}' for s, n in stages.items())}" if stages else "")


def _facts(folder: Path, results: list[Replayed], changes: list[str]) -> dict[str, Any]:
    """The result as JSON."""
    return {
        "run_dir": str(folder),
        "identical": sum(result.identical for result in results),
        "attempts": len(results),
        "environment_changes": changes,
        "different": [
            {
                "attempt_id": r.attempt_id,
                "differences": [{"stage": str(d.stage), "what": d.what} for d in r.differences],
            }
            for r in results
            if not r.identical
        ],
    }


def _other_model(args: argparse.Namespace, recorded: RecordedRun, attempts: Iterator[RecordedAttempt]) -> int:
    """What another model would have done."""
    pipelines: dict[str, Pipeline] = {}
    found: list[WhatIf] = []
    for attempt in attempts:
        if attempt.run_id not in pipelines:
            pipelines[attempt.run_id] = _pipeline(recorded.sessions[attempt.run_id], args.model, args.weights)
        found.append(what_if(attempt, pipelines[attempt.run_id]))
        say(found[-1].line())
    say(f"{args.model} would have picked in {sum(f.would_pick for f in found)} of {len(found)} attempts")
    write_json_file(args.json, [f.facts() for f in found])
    return 0
