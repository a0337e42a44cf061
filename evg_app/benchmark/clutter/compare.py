"""Two result files, paired by round."""

import json
from pathlib import Path
from typing import Any

from evg_app.benchmark.clutter.rounds import RoundResult
from evg_app.benchmark.clutter.summary import paired
from evg_app.errors import BadInput


def compare(path_a: Path, path_b: Path) -> dict[str, Any]:
    """GSR and DR of both on the rounds they share, and the difference b - a with its 95 % interval.

    Raises:
        BadInput: a file is not a result of the benchmark, or the two are of different scenes.
    """
    a, b = _read(path_a), _read(path_b)
    for key in sorted(a["scenes"].keys() | b["scenes"].keys()):
        if a["scenes"].get(key) != b["scenes"].get(key):
            raise BadInput(
                f"{path_a} and {path_b} cannot be paired: {key} is {a['scenes'].get(key)} in the first and "
                f"{b['scenes'].get(key)} in the second; run both with the same options"
            )
    rows_a, rows_b = ([RoundResult.from_dict(row) for row in facts["rows"]] for facts in (a, b))
    models = {"model_a": a["model"], "model_b": b["model"], "file_a": str(path_a), "file_b": str(path_b)}
    hashes = {"weights_sha256_a": a["weights_sha256"], "weights_sha256_b": b["weights_sha256"]}
    return models | hashes | paired(rows_a, rows_b)


def _read(path: Path) -> dict[str, Any]:
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        missing = [key for key in ("scenes", "rows", "model", "weights_sha256") if key not in facts]
        shaped = isinstance(facts, dict) and not missing and isinstance(facts["scenes"], dict)
    except (OSError, ValueError, TypeError) as error:
        raise BadInput(f"{path} cannot be read ({error}); give a file that `benchmark clutter --json` wrote") from error
    if not shaped:
        raise BadInput(f"{path} is not a result of the benchmark; give a file that `benchmark clutter --json` wrote")
    answer: dict[str, Any] = facts
    return answer
