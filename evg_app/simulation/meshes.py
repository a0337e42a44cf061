"""Triangle meshes made of parts, and the OBJ subset they are kept in (one `o` group per convex part)."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from evg_app.errors import BadInput
from evg_app.geometry import Array


@dataclass(frozen=True)
class Mesh:
    """Triangles: `vertices` float64 (V, 3) [m], `faces` int64 (F, 3), counter-clockwise from outside."""

    vertices: Array
    faces: NDArray[np.int64]


def hull(points: Array) -> Mesh:
    """Convex hull with outward faces and no unused vertex. `points` has shape (V, 3) [m]."""
    body = ConvexHull(points)
    used = np.sort(np.asarray(body.vertices))
    index = np.full(len(points), -1, dtype=np.int64)
    index[used] = np.arange(len(used))
    faces = index[np.asarray(body.simplices)]
    v = points[used]
    normal = np.cross(v[faces[:, 1]] - v[faces[:, 0]], v[faces[:, 2]] - v[faces[:, 0]])
    inward = np.einsum("ij,ij->i", normal, np.asarray(body.equations)[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(v, faces)


def volume_and_center(parts: tuple[Mesh, ...]) -> tuple[float, Array]:
    """Volume [m^3] and centre of mass [m] of solid parts (overlaps count twice)."""
    volume, moment = 0.0, np.zeros(3)
    for mesh in parts:
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        tetra = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
        volume += float(tetra.sum())
        moment += (tetra[:, None] * (a + b + c) / 4.0).sum(axis=0)
    return volume, moment / volume


def merged(parts: tuple[Mesh, ...]) -> Mesh:
    """All parts as one mesh."""
    offsets = np.cumsum([0, *(len(m.vertices) for m in parts[:-1])])
    faces = [m.faces + k for m, k in zip(parts, offsets, strict=True)]
    return Mesh(np.concatenate([m.vertices for m in parts]), np.concatenate(faces))


def obj_text(parts: tuple[Mesh, ...]) -> str:
    """The parts as OBJ text; PyBullet collides each `o` group as one convex hull."""
    lines, offset = [], 1
    for number, mesh in enumerate(parts):
        lines.append(f"o part_{number}")
        lines += [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in mesh.vertices.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + offset).tolist()]
        offset += len(mesh.vertices)
    return "\n".join(lines) + "\n"


def _corner(token: str, seen: int) -> int:
    index = int(token.split("/")[0])
    return index - 1 if index > 0 else seen + index


def _parse(text: str) -> tuple[Array, list[list[tuple[int, int, int]]]]:
    vertices: list[list[float]] = []
    groups: list[list[tuple[int, int, int]]] = [[]]
    for line in text.splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([float(w) for w in words[1:4]])
        elif words[0] == "f":
            c = [_corner(w, len(vertices)) for w in words[1:]]
            groups[-1] += [(c[0], c[k], c[k + 1]) for k in range(1, len(c) - 1)]
        elif words[0] == "o" and groups[-1]:
            groups.append([])
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), [g for g in groups if g]


def _compact(vertices: Array, group: list[tuple[int, int, int]]) -> Mesh:
    faces = np.array(group, dtype=np.int64)
    used, local = np.unique(faces, return_inverse=True)
    return Mesh(vertices[used], local.reshape(faces.shape).astype(np.int64))


@lru_cache(maxsize=2048)
def load_parts(path: Path) -> tuple[Mesh, ...]:
    """The parts of an OBJ file, one for each `o` group that has faces. Cached: treat the arrays as read-only.

    Raises:
        BadInput: the file cannot be read, has no faces, non-finite vertices or faces that point nowhere.
    """
    try:
        vertices, groups = _parse(path.read_text(encoding="utf-8", errors="strict"))
    except (OSError, ValueError, IndexError) as error:
        raise BadInput(f"{path}: not a readable OBJ mesh ({error}). Replace or remove the file.") from error
    if not groups:
        raise BadInput(f"{path}: the mesh has no faces. Replace or remove the file.")
    if not np.isfinite(vertices).all():
        raise BadInput(f"{path}: the mesh has vertices that are not finite numbers. Replace or remove the file.")
    corners = [index for group in groups for face in group for index in face]
    if min(corners) < 0 or max(corners) >= len(vertices):
        raise BadInput(f"{path}: a face names a vertex that does not exist (of {len(vertices)}). Repair the file.")
    return tuple(_compact(vertices, group) for group in groups)


@lru_cache(maxsize=2048)
def half_spaces(path: Path) -> tuple[Array, ...]:
    """Half spaces (n, d) of each part's convex hull: inside where n.p + d <= 0. Shapes (F_i, 4)."""
    try:
        return tuple(np.asarray(ConvexHull(part.vertices).equations) for part in load_parts(path))
    except QhullError as error:
        raise BadInput(f"{path}: a part of the mesh has no volume. Repair the file.") from error
