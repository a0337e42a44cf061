"""A run as MCAP: depth, point cloud, frames, chosen grasp and events on one time line. Opens in Foxglove.

Messages are JSON in Foxglove's own schemas (docs.foxglove.dev, "Schemas"). Time is the wall time of the log.
"""

import base64
import json
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from evg_app.errors import MissingExtra
from evg_app.geometry import Array, invert, to_quaternion
from evg_app.perception.projection import points_in
from evg_app.trials import schema
from evg_app.trials.arrays import frame_of
from evg_app.trials.foxglove import SCHEMAS
from evg_app.trials.recorded import RecordedAttempt, RecordedRun

TOPICS = {
    "/events": "evg.Event",
    "/camera/depth": "foxglove.RawImage",
    "/camera/points": "foxglove.PointCloud",
    "/tf": "foxglove.FrameTransform",
    "/grasp": "foxglove.PosesInFrame",
    "/log": "foxglove.Log",
}
"""Topics and their schemas."""
STRIDE = 2
"""Every STRIDE-th row and column becomes a point."""
Message = tuple[str, dict[str, Any]]


def export_mcap(folder: Path, target: Path) -> int:
    """Write a run; how many messages it has.

    Raises:
        BadInput: the folder holds no readable trial log.
        MissingExtra: mcap is not installed.
        OSError: the file cannot be written.
    """
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise MissingExtra("mcap", "export") from error
    recorded, count = RecordedRun(folder), 0
    part = target.with_name(target.name + ".part")
    with part.open("wb") as stream:
        writer: Any = Writer(stream)
        writer.start(profile="", library="evg-app")
        channels = {topic: _channel(writer, topic, name) for topic, name in TOPICS.items()}
        for stamp_ns, (topic, message) in _messages(recorded):
            data = json.dumps(message).encode("utf-8")
            writer.add_message(channels[topic], stamp_ns, data, stamp_ns, sequence=count)
            count += 1
        writer.finish()
    part.replace(target)
    return count


def _channel(writer: Any, topic: str, name: str) -> int:
    """Register a topic and its schema; its number."""
    data = json.dumps(SCHEMAS[name]).encode("utf-8")
    schema_id = writer.register_schema(name, "jsonschema", data)
    return int(writer.register_channel(topic, "json", schema_id))


def _messages(recorded: RecordedRun) -> Iterator[tuple[int, Message]]:
    """Everything in the order of the log; an attempt's arrays come with the event that it was fused."""
    kept = set(recorded.attempt_ids)
    db = schema.open_existing(recorded.folder)
    try:
        for row in db.execute("SELECT attempt_id, kind, at, data FROM events ORDER BY rowid"):
            stamp_ns = int(datetime.fromisoformat(row["at"]).timestamp() * 1000) * 1_000_000
            data = json.loads(row["data"])
            yield stamp_ns, ("/events", {"kind": row["kind"], "attempt_id": row["attempt_id"], "data": data})
            if row["kind"] == "Warned":
                yield stamp_ns, ("/log", _log(stamp_ns, data))
            if row["kind"] == "AttemptFinished" and row["attempt_id"] in kept:
                for message in _arrays(recorded.attempt(row["attempt_id"]), stamp_ns):
                    yield stamp_ns, message
    finally:
        db.close()


def _arrays(attempt: RecordedAttempt, stamp_ns: int) -> Iterator[Message]:
    """What an attempt saw and chose."""
    if "frame" not in attempt.reached:
        return
    taken, stamp = frame_of(attempt.stored), _time(stamp_ns)
    frame = taken.frame
    yield "/tf", _transform(stamp, "base", "task", taken.T_base_task)
    yield "/tf", _transform(stamp, "base", "camera", taken.T_base_cam)
    yield (
        "/camera/depth",
        {
            "timestamp": stamp,
            "frame_id": "camera",
            "width": frame.intrinsics.width,
            "height": frame.intrinsics.height,
            "encoding": "16UC1",
            "step": 2 * frame.intrinsics.width,
            "data": _base64(frame.depth.astype("<u2")),
        },
    )
    sparse = frame.metres()[::STRIDE, ::STRIDE]
    points = points_in(np.ascontiguousarray(sparse), frame.intrinsics, invert(taken.T_base_cam), STRIDE)
    yield "/camera/points", _cloud(stamp, points.T.astype(np.float64))
    chosen = int(attempt.stored["chosen"])
    if chosen >= 0 and "T_base_grasp" in attempt.stored:
        poses = [_pose(attempt.stored["T_base_grasp"])]
        yield "/grasp", {"timestamp": stamp, "frame_id": "base", "poses": poses}


def _cloud(stamp: Mapping[str, int], points: Array) -> dict[str, Any]:
    """Points (N, 3) [m] as a message."""
    fields = [{"name": name, "offset": 4 * i, "type": 7} for i, name in enumerate("xyz")]
    return {
        "timestamp": stamp,
        "frame_id": "base",
        "pose": _pose(np.eye(4)),
        "point_stride": 12,
        "fields": fields,
        "data": _base64(points.astype("<f4")),
    }


def _log(stamp_ns: int, data: Mapping[str, Any]) -> dict[str, Any]:
    """A warning as a message."""
    text = f"{data.get('cause', '')}: {data.get('text', '')}"
    return {"timestamp": _time(stamp_ns), "level": 3, "message": text, "name": "evg-app", "file": "", "line": 0}


def _transform(stamp: Mapping[str, int], parent: str, child: str, T: Array) -> dict[str, Any]:
    """A pose (4, 4) as a frame of the parent."""
    pose = _pose(T)
    names = {"timestamp": stamp, "parent_frame_id": parent, "child_frame_id": child}
    return {**names, "translation": pose["position"], "rotation": pose["orientation"]}


def _pose(T: Array) -> dict[str, dict[str, float]]:
    """A pose (4, 4) in Foxglove's words."""
    x, y, z, w = to_quaternion(T).tolist()
    px, py, pz = T[:3, 3].tolist()
    return {"position": {"x": px, "y": py, "z": pz}, "orientation": {"x": x, "y": y, "z": z, "w": w}}


def _time(stamp_ns: int) -> dict[str, int]:
    """A time stamp in seconds and nanoseconds."""
    return {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9}


def _base64(array: np.ndarray[Any, Any]) -> str:
    """The bytes of an array as text."""
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
