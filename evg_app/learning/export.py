"""Checkpoint to shipped weights: safetensors of the averaged weights, and a card beside it."""

import hashlib
import json
import pickle
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save_file

from evg_app.errors import BadInput
from evg_app.nets.registry import build

INTENDED_USE = (
    "Grasps of a parallel gripper (opening 80 mm, fingers 50 mm) from one depth image of a 0.3 m cube above a table, "
    "as a 40^3 TSDF in Open3D's convention (spec §1): side or oblique views."
)
LIMITS = (
    "Trained in simulation on rigid objects of up to about 15 cm with friction from 0.5 up; no soft, transparent or "
    "articulated things."
)


def export_weights(checkpoint: Path, out: Path, extra: dict[str, Any] | None = None) -> Path:
    """Write `out` (NAME.safetensors) and NAME.json from a training checkpoint; returns the card's path.

    Args:
        checkpoint: written by `train`.
        out: ends in .safetensors.
        extra: added to the card's "training", e.g. a benchmark.

    Raises:
        BadInput: the checkpoint cannot be read, or `out` has another ending.
    """
    if out.suffix != ".safetensors":
        raise BadInput(f"weights go to a .safetensors file, not {out}; give --out NAME.safetensors")
    try:
        state = torch.load(checkpoint, weights_only=True, map_location="cpu")
    except (OSError, RuntimeError, ValueError, EOFError, pickle.UnpicklingError) as error:
        raise BadInput(
            f"{checkpoint} is not a readable checkpoint ({str(error).splitlines()[0][:80]}); run evg-app train first"
        ) from error
    config = json.loads(state["config"])
    model: Any = build(config["architecture"], config["network"])
    model.load_state_dict(state["average"])
    out.parent.mkdir(parents=True, exist_ok=True)
    save_file({k: v.contiguous() for k, v in model.state_dict().items()}, str(out))
    out.chmod(0o644)
    card = {
        "name": out.stem,
        "architecture": config["architecture"],
        "config": model.config.to_dict(),
        "sha256": hashlib.sha256(out.read_bytes()).hexdigest(),
        "parameters": sum(p.numel() for p in model.parameters()),
        "training": _training(state, config) | (extra or {}),
        "metrics": {k: round(float(v), 4) for k, v in state["metrics"].items()},
        "intended_use": INTENDED_USE,
        "limits": LIMITS,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "git_commit": _commit(),
    }
    path = out.with_suffix(".json")
    path.write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
    return path


def _training(state: dict[str, Any], config: dict[str, Any]) -> dict[str, Any]:
    """How the weights came about."""
    start = {"started_from_weights_sha256": state["started_from"]} if state["started_from"] else {}
    return start | {
        "data": json.loads(state["data"]),
        "seed": config["seed"],
        "minutes": round(state["used_seconds"] / 60.0, 1),
        "steps": state["step"],
        "scene_visits": state["scene_visits"],
        "averaged": f"exponential, decay {config['ema']}",
        "recipe": {k: config[k] for k in ("batch", "sizes", "learning_rate", "final_rate", "clip")},
    }


def _commit() -> str:
    """Commit of the code, or "unknown" outside a repository."""
    command = ["git", "rev-parse", "HEAD"]
    try:
        answer = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True, timeout=10
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return answer.stdout.strip()
