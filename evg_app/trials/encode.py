"""Events as JSON: the small facts; images, grids, grasps and trajectories go to the arrays."""

import json
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from evg_app.events import Event
from evg_app.types import CollisionVolume, Frame, Grasps, Trajectory, TsdfGrid, Verdict

SMALL = 64
"""Arrays up to this many numbers are written out."""


def encode(event: Event) -> str:
    """One event as a JSON object."""
    return json.dumps({f.name: _plain(getattr(event, f.name)) for f in fields(event)}, allow_nan=False)


def _plain(value: Any) -> Any:
    """Something JSON can hold."""
    if isinstance(value, (CollisionVolume, Frame, Grasps, Trajectory, TsdfGrid)):
        return _headline(value)
    if isinstance(value, tuple) and value and isinstance(value[0], Verdict):
        return {"candidates": len(value)}
    if isinstance(value, np.ndarray):
        return [_plain(v) for v in value.tolist()] if value.size <= SMALL else {"shape": list(value.shape)}
    if isinstance(value, Enum):
        return str(value.value)
    if is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    return _scalar(value)


def _scalar(value: Any) -> Any:
    """A number that JSON knows; what is not finite becomes a word."""
    if isinstance(value, (np.bool_, np.integer)):
        return value.item()
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else str(value)
    return value


def _headline(value: CollisionVolume | Frame | Grasps | Trajectory | TsdfGrid) -> dict[str, Any]:
    """What a reader of the event wants to know about a large value."""
    if isinstance(value, Frame):
        return {"stamp": value.stamp, "number": value.number, "frame_id": value.frame_id}
    if isinstance(value, Grasps):
        return {"candidates": len(value), "best_score": _scalar(value.score.max()) if len(value) else None}
    if isinstance(value, Trajectory):
        return {"duration_s": value.duration, "samples": len(value.q)}
    return {"observed_voxels": int(value.observed.sum())}
