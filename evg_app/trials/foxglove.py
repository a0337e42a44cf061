"""The message types of Foxglove that a run is exported in, as JSON schemas: names and types as Foxglove has them.

Foxglove decodes bytes only where the schema says `contentEncoding: base64` (docs.foxglove.dev, "Schemas").
"""

from typing import Any

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
COUNT: Schema = {"type": "integer", "minimum": 0}
TEXT: Schema = {"type": "string"}
BYTES: Schema = {"type": "string", "contentEncoding": "base64"}


def _object(title: str, **fields: Schema) -> Schema:
    """An object that has these fields."""
    return {"type": "object", "title": title, "properties": fields, "required": list(fields)}


TIME = _object("time", sec=COUNT, nsec=COUNT | {"maximum": 999_999_999})
VECTOR = _object("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
QUATERNION = _object("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
POSE = _object("foxglove.Pose", position=VECTOR, orientation=QUATERNION)
FIELD = _object("foxglove.PackedElementField", name=TEXT, offset=COUNT, type=COUNT | {"maximum": 8})

SCHEMAS: dict[str, Schema] = {
    str(schema["title"]): schema
    for schema in (
        _object(
            "foxglove.RawImage",
            timestamp=TIME,
            frame_id=TEXT,
            width=COUNT,
            height=COUNT,
            encoding=TEXT,
            step=COUNT,
            data=BYTES,
        ),
        _object(
            "foxglove.PointCloud",
            timestamp=TIME,
            frame_id=TEXT,
            pose=POSE,
            point_stride=COUNT,
            fields={"type": "array", "items": FIELD},
            data=BYTES,
        ),
        _object(
            "foxglove.FrameTransform",
            timestamp=TIME,
            parent_frame_id=TEXT,
            child_frame_id=TEXT,
            translation=VECTOR,
            rotation=QUATERNION,
        ),
        _object("foxglove.PosesInFrame", timestamp=TIME, frame_id=TEXT, poses={"type": "array", "items": POSE}),
        _object(
            "foxglove.Log",
            timestamp=TIME,
            level=COUNT | {"maximum": 5},
            message=TEXT,
            name=TEXT,
            file=TEXT,
            line=COUNT,
        ),
        {"type": "object", "title": "evg.Event", "properties": {"kind": TEXT}},
    )
}
"""By name."""
