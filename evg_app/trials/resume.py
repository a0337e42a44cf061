"""Going on with a run that was interrupted: which rounds are done, and whether it is still the same experiment."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from evg_app.errors import BadInput
from evg_app.events import StopReason
from evg_app.trials.rows import read_rows

UNFINISHED = (None, str(StopReason.STOPPED), str(StopReason.ERROR))
"""Ends of rounds that are begun again."""
FREE = ("arguments",)
"""Parts of the snapshot that may differ between sessions: where to write, how often, how fast to pace."""


def finished_rounds(folder: Path) -> frozenset[tuple[int, int]]:
    """Rounds (seed, index) that ended by the rules.

    Raises:
        BadInput: the folder holds no readable trial log.
    """
    rounds = read_rows(folder).rounds
    return frozenset((r["seed"], r["round_index"]) for r in rounds if r["stop_reason"] not in UNFINISHED)


def require_same(folder: Path, config: Mapping[str, Any], model: str, weights_sha256: str) -> None:
    """Pass when a run with this configuration and planner may be counted together with what the folder holds.

    Raises:
        BadInput: it may not; the message names what changed.
    """
    last = read_rows(folder).runs[-1]
    before, now = json.loads(last["config"]), json.loads(json.dumps(config, default=str))
    changed = sorted(
        f"{part}.{key}" if isinstance(before.get(part), dict) and isinstance(now.get(part), dict) else part
        for part in (set(before) | set(now)) - set(FREE)
        for key in _changed(before.get(part), now.get(part))
    )
    if last["model"] != model:
        changed.append(f"model ({last['model']}, now {model})")
    if last["weights_sha256"] != weights_sha256:
        changed.append(f"weights ({last['weights_sha256'][:12] or 'none'}, now {weights_sha256[:12] or 'none'})")
    if changed:
        raise BadInput(
            f"{folder} was recorded with another setting: {', '.join(changed)}. "
            "Set it back to go on, or start a new run folder"
        )


def _changed(before: Any, now: Any) -> list[str]:
    """Keys whose values differ; one empty key for a difference that has none."""
    if isinstance(before, dict) and isinstance(now, dict):
        return [key for key in sorted(set(before) | set(now)) if before.get(key) != now.get(key)]
    return [] if before == now else [""]
