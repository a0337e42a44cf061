"""The arrays of one attempt: everything replay needs, in one compressed file that is there whole or not at all."""

import hashlib
import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from evg_app.events import Event, FrameTaken, Fused, GraspsPlanned, Judged, Routed, ViewTaken
from evg_app.types import Frame, Grasps, Intrinsics, Trajectory


@dataclass
class Gathered:
    """What the events of one pass brought so far; a new frame (the scene had changed) begins it again."""

    frame: FrameTaken | None = None
    views: list[ViewTaken] = field(default_factory=list)
    fused: Fused | None = None
    grasps: Grasps = field(default_factory=Grasps.empty)
    judged: Judged | None = None
    planned: bool = False
    routes: list[Routed] = field(default_factory=list)

    def reached(self) -> list[str]:
        """How far the pass came: some of "frame", "fused", "planned", "judged"."""
        came = {
            "frame": self.frame is not None,
            "fused": self.fused is not None,
            "planned": self.planned,
            "judged": self.judged is not None,
        }
        return [name for name, done in came.items() if done]

    def take(self, event: Event) -> None:
        """Keep what this event brings, if anything."""
        if isinstance(event, FrameTaken):
            self.frame, self.fused, self.judged = event, None, None
            self.grasps, self.planned = Grasps.empty(), False
        elif isinstance(event, ViewTaken):
            self.views[event.index :] = [event]
        elif isinstance(event, Fused):
            self.fused = event
        elif isinstance(event, GraspsPlanned):
            self.grasps, self.planned = event.grasps, True
        elif isinstance(event, Judged):
            self.judged = event
        elif isinstance(event, Routed):
            self.routes.append(event)

    def arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """By name, as they are written."""
        return {**self._seen(), **_further(self.views), **self._proposed(), **self._moved(), **_ways(self.routes)}

    def _seen(self) -> dict[str, np.ndarray[Any, Any]]:
        """The frame, its optics and poses, and what was fused."""
        out: dict[str, np.ndarray[Any, Any]] = {}
        if self.frame is not None:
            frame, i = self.frame.frame, self.frame.frame.intrinsics
            out = {
                "depth": frame.depth,
                "depth_scale": np.float64(frame.depth_scale) * np.ones(()),
                "stamp": np.float64(frame.stamp) * np.ones(()),
                "frame_number": np.array(frame.number),
                "image_size": np.array([i.width, i.height]),
                "focal_centre": np.array([i.fx, i.fy, i.cx, i.cy]),
                "distortion": np.array(i.distortion, dtype=np.float64),
                "T_base_cam": self.frame.T_base_cam,
                "T_base_task": self.frame.T_base_task,
                "q": self.frame.q,
            }
            if frame.color is not None:
                out["color"] = frame.color
        return out | ({} if self.fused is None else _fused(self.fused))

    def _proposed(self) -> dict[str, np.ndarray[Any, Any]]:
        """The candidates and their verdicts."""
        verdicts = [] if self.judged is None else [str(verdict.value) for verdict in self.judged.verdicts]
        return {
            "reached": np.array(self.reached(), dtype="U8"),
            "T_task_grasp": self.grasps.T_task_grasp,
            "width": self.grasps.width,
            "score": self.grasps.score,
            "verdict": np.array(verdicts, dtype="U32"),
        }

    def _moved(self) -> dict[str, np.ndarray[Any, Any]]:
        """The chosen grasp and its motions."""
        if self.judged is None or self.judged.chosen is None or self.judged.T_base_grasp is None:
            return {"chosen": np.array(-1)}
        out = {
            "chosen": np.array(self.judged.chosen),
            "flipped": np.array(self.judged.flipped),
            "T_base_grasp": self.judged.T_base_grasp,
        }
        for name, path in self.judged.trajectories.items():
            out |= _trajectory(name, path)
        return out


def _fused(fused: Fused) -> dict[str, np.ndarray[Any, Any]]:
    """Grid, mask and collision volume."""
    out = {
        "tsdf": fused.grid.values,
        "observed": fused.grid.observed,
        "depth_factor": np.array(fused.depth_factor),
        "points": np.array(fused.points),
    }
    if fused.volume is not None:
        out |= {
            "volume_occupied": fused.volume.occupied,
            "volume_observed": fused.volume.observed,
            "volume_origin": fused.volume.origin,
            "volume_voxel_size": np.array(fused.volume.voxel_size),
        }
    return out


def _further(views: Sequence[ViewTaken]) -> dict[str, np.ndarray[Any, Any]]:
    """The further views, stacked; nothing when there are none."""
    if not views:
        return {}
    return {
        "views.depth": np.stack([view.frame.depth for view in views]),
        "views.depth_scale": np.array([view.frame.depth_scale for view in views], dtype=np.float64),
        "views.stamp": np.array([view.frame.stamp for view in views], dtype=np.float64),
        "views.q": np.stack([view.q for view in views]),
        "views.T_base_cam": np.stack([view.T_base_cam for view in views]),
    }


def _ways(routes: Sequence[Routed]) -> dict[str, np.ndarray[Any, Any]]:
    """Ways to the look pose and back, in the order they were planned."""
    out: dict[str, np.ndarray[Any, Any]] = {}
    for number, route in enumerate(routes):
        name = f"routes.{number}"
        out |= {
            f"{name}.name": np.array(route.name),
            f"{name}.q_start": route.q_start,
            f"{name}.q_goal": route.q_goal,
            f"{name}.around_scene": np.array(route.around_scene),
            **_trajectory(name, route.way),
        }
    return out


def routes_of(stored: Mapping[str, np.ndarray[Any, Any]]) -> list[Routed]:
    """The ways that an attempt's arrays hold."""
    routes: list[Routed] = []
    while (name := f"routes.{len(routes)}") + ".q_start" in stored:
        joints = tuple(str(joint) for joint in stored[f"{name}.joint_names"])
        q, dq, ddq = (stored[f"{name}.{part}"] for part in ("q", "dq", "ddq"))
        way = Trajectory(joints, float(stored[f"{name}.dt"]), q, dq, ddq)
        ends = stored[f"{name}.q_start"], stored[f"{name}.q_goal"]
        routes.append(Routed(str(stored[f"{name}.name"]), *ends, bool(stored[f"{name}.around_scene"]), way))
    return routes


def views_of(stored: Mapping[str, np.ndarray[Any, Any]]) -> list[ViewTaken]:
    """The further views that an attempt's arrays hold, with the optics of its frame."""
    if "views.depth" not in stored:
        return []
    frame = frame_of(stored).frame
    return [
        ViewTaken(
            index,
            replace(
                frame,
                depth=stored["views.depth"][index],
                depth_scale=float(stored["views.depth_scale"][index]),
                stamp=float(stored["views.stamp"][index]),
                color=None,
            ),
            stored["views.q"][index],
            stored["views.T_base_cam"][index],
        )
        for index in range(len(stored["views.depth"]))
    ]


def frame_of(stored: Mapping[str, np.ndarray[Any, Any]]) -> FrameTaken:
    """The frame that an attempt's arrays hold.

    Raises:
        KeyError: they hold none.
    """
    width, height = (int(n) for n in stored["image_size"])
    fx, fy, cx, cy = (float(x) for x in stored["focal_centre"])
    intrinsics = Intrinsics(width, height, fx, fy, cx, cy, tuple(float(x) for x in stored["distortion"]))
    number = int(stored["frame_number"]) if "frame_number" in stored else 0
    frame = Frame(
        stored["depth"],
        float(stored["depth_scale"]),
        intrinsics,
        float(stored["stamp"]),
        "recorded",
        stored.get("color"),
        number,
    )
    return FrameTaken(frame, stored["q"], stored["T_base_cam"], stored["T_base_task"])


def _trajectory(name: str, path: Trajectory) -> dict[str, np.ndarray[Any, Any]]:
    """The samples of a motion, under its name."""
    return {
        f"{name}.q": path.q,
        f"{name}.dq": path.dq,
        f"{name}.ddq": path.ddq,
        f"{name}.dt": np.array(path.dt),
        f"{name}.joint_names": np.array(path.joint_names),
    }


def write(path: Path, gathered: Gathered) -> str:
    """Write atomically: the bytes are on the disk before the name appears. Returns their sha256.

    Raises:
        OSError: they cannot be written.
    """
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **gathered.arrays())  # type: ignore[arg-type]
    write_atomically(path, buffer.getvalue())
    return hashlib.sha256(buffer.getvalue()).hexdigest()


def write_atomically(path: Path, data: bytes) -> None:
    """Write `data` so that `path` is never half a file, and is there after a power cut."""
    part = path.with_name(path.name + ".part")
    with part.open("wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def read(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    """The arrays of one attempt, by name. Nothing is unpickled."""
    with np.load(path, allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file atomically."""
    write_atomically(path, (json.dumps(value, indent=2, default=str) + "\n").encode("utf-8"))
