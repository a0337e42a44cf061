"""What is drawn for one pass, from its arrays as the log holds them (`trials/arrays.py`): pure, base frame [m]."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from evg_app.geometry import VOXEL_SIZE, Array, invert, transform_points
from evg_app.perception.projection import points_in
from evg_app.trials.arrays import frame_of
from evg_app.trials.pictures import depth_as_color, gripper_lines
from evg_app.viewer.colors import Bytes, by_share, by_verdict

Stored = Mapping[str, np.ndarray[Any, Any]]

STRIDE = 3
"""Every n-th pixel of the depth image becomes a point."""
MAX_CANDIDATES = 400
"""More are not drawn; the best are."""
ORDER = ("reach", "approach", "lift", "transport", "back", "retreat")
"""The planned motions in the order they are driven."""
TO_GRASP = ("reach", "approach")
"""Those until the fingers close."""
SURFACE = 0.5
"""TSDF values from here down are inside or at the surface."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """One pass as points, lines and joint positions, all in the base frame [m]. Empty where it never got that far.

    Attributes:
        cloud, cloud_colors: what the camera saw. Shapes (N, 3), uint8 (N, 3).
        voxels, voxel_colors: the TSDF's voxels at the surface, coloured by height. Shapes (V, 3), uint8 (V, 3).
        candidates: four segments for each drawn candidate. Shape (4 C, 2, 3).
        by_verdict, by_score: colours of the candidates' segments. Shape (4 C, 2, 3), uint8.
        verdicts: how many candidates have which verdict, most frequent first.
        chosen: four segments of the grasp that is executed, or none. Shape (4, 2, 3) or (0, 2, 3).
        path: the planned joint path, all motions one after the other [rad]. Shape (M, J).
        grasp_at: index into `path` where the fingers close; 0 without a path.
        q: where the arm stood when the frame was taken [rad], shape (J,), or None.
        workspace: twelve edges of the cube. Shape (12, 2, 3), or (0, 2, 3).
        image: uint8 RGB (H, W, 3), depth in false colours where there is no colour; None without a frame.
    """

    cloud: Array
    cloud_colors: Bytes
    voxels: Array
    voxel_colors: Bytes
    candidates: Array
    by_verdict: Bytes
    by_score: Bytes
    verdicts: Mapping[str, int]
    chosen: Array
    path: Array
    grasp_at: int
    q: Array | None
    workspace: Array
    image: Bytes | None


def drawing(stored: Stored) -> Drawing:
    """What to draw for a pass, as far as it came."""
    cloud, cloud_colors, image, q = _seen(stored)
    T_base_task = stored.get("T_base_task")
    voxels, voxel_colors = _voxels(stored, T_base_task)
    candidates, verdict_colors, score_colors = _candidates(stored, T_base_task)
    path, grasp_at = _path(stored)
    return Drawing(
        cloud,
        cloud_colors,
        voxels,
        voxel_colors,
        candidates,
        verdict_colors,
        score_colors,
        _counted(stored),
        _chosen(stored),
        path,
        grasp_at,
        q,
        np.zeros((0, 2, 3)) if T_base_task is None else _cube(stored, T_base_task),
        image,
    )


def _seen(stored: Stored) -> tuple[Array, Bytes, Bytes | None, Array | None]:
    """What the camera saw as points, their colours, the image, and where the arm stood."""
    if "depth" not in stored:
        return np.zeros((0, 3)), np.zeros((0, 3), np.uint8), None, None
    taken = frame_of(stored)
    frame = taken.frame
    image = frame.color if frame.color is not None else depth_as_color(frame)
    sparse = frame.metres()[::STRIDE, ::STRIDE]
    valid = (sparse > 0) & (sparse < 2.0)  # as `points_in` takes them
    points = points_in(sparse, frame.intrinsics, invert(taken.T_base_cam), STRIDE).T
    return points.astype(np.float64), image[::STRIDE, ::STRIDE][valid], image, taken.q


def _voxels(stored: Stored, T_base_task: Array | None) -> tuple[Array, Bytes]:
    """Centres of the surface voxels and their colours."""
    if "tsdf" not in stored or T_base_task is None:
        return np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    values = stored["tsdf"]
    index = np.argwhere((values > 0) & (values <= SURFACE) & stored["observed"])
    centres = (index + 0.5) * VOXEL_SIZE
    return transform_points(T_base_task, centres), by_share(index[:, 2] / values.shape[2])


def _candidates(stored: Stored, T_base_task: Array | None) -> tuple[Array, Bytes, Bytes]:
    """Segments, and their colours by verdict and by score, the best candidates first."""
    n = min(len(stored.get("score", ())), MAX_CANDIDATES)
    if not n or T_base_task is None:
        return np.zeros((0, 2, 3)), np.zeros((0, 2, 3), np.uint8), np.zeros((0, 2, 3), np.uint8)
    poses, widths = T_base_task @ stored["T_task_grasp"][:n], stored["width"][:n]
    lines = [transform_points(T, gripper_lines(float(w))) for T, w in zip(poses, widths, strict=True)]
    verdict_colors = by_verdict([str(word) for word in stored["verdict"]], n)
    return np.concatenate(lines), _spread(verdict_colors), _spread(by_share(stored["score"][:n]))


def _spread(colors: Bytes) -> Bytes:
    """One colour a candidate to one for each end of its four segments. Shapes (C, 3) -> (4 C, 2, 3)."""
    return np.repeat(np.repeat(colors, 4, axis=0)[:, None], 2, axis=1)


def _counted(stored: Stored) -> dict[str, int]:
    """Candidates by verdict, most frequent first."""
    return dict(Counter(str(word) for word in stored.get("verdict", ())).most_common())


def _chosen(stored: Stored) -> Array:
    """The executed grasp as segments."""
    chosen = int(stored.get("chosen", -1))
    if chosen < 0 or "T_base_grasp" not in stored:
        return np.zeros((0, 2, 3))
    return transform_points(stored["T_base_grasp"], gripper_lines(float(stored["width"][chosen])))


def _path(stored: Stored) -> tuple[Array, int]:
    """All motions one after the other, and where the fingers close."""
    parts = {name: stored[f"{name}.q"] for name in ORDER if f"{name}.q" in stored}
    if not parts:
        return np.zeros((0, 0)), 0
    to_grasp = sum(len(parts[name]) for name in TO_GRASP if name in parts)
    return np.concatenate(list(parts.values())), max(to_grasp - 1, 0)


def _cube(stored: Stored, T_base_task: Array) -> Array:
    """Edges of the workspace."""
    size = VOXEL_SIZE * (stored["tsdf"].shape[0] if "tsdf" in stored else 40)
    corners = np.array([[x, y, z] for x in (0, size) for y in (0, size) for z in (0, size)])
    pairs = [(a, b) for a in range(8) for b in range(a + 1, 8) if bin(a ^ b).count("1") == 1]
    return transform_points(T_base_task, corners[np.array(pairs)])
