"""Corners of AprilTags to a few hundredths of a pixel: lines through the four edges of a tag, and where they meet.

A search for the corner itself (`cornerSubPix`) needs a saddle of grey as chessboards have; at the outer corner of a tag
it is off by 0.4 px. Edges are straight only without lens distortion, so lines are fitted to undistorted points.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evg_app.config.calibration import project
from evg_app.geometry import Array
from evg_app.handeye.boards import Gray, opencv
from evg_app.handeye.lens import undistort
from evg_app.types import Intrinsics

MODULES = 8
"""Squares along the side of a 36h11 tag, its black border included."""
ALONG = 24
"""Places along each edge at which its position is measured."""
FROM_CORNER = 0.1
"""This share of an edge at both ends, where two edges blur into each other, is not used."""
ACROSS = 17
"""Grey values along each profile across an edge."""
ROUNDS = 3
"""Edges are looked for again around the corners found."""
LEAST_CONTRAST = 20.0
"""Grey levels between the two sides of an edge."""
MAX_OFF_LINE = 0.35
"""RMS distance of an edge's points from their line above which something covers the edge [px]."""


@dataclass(frozen=True)
class _Edges:
    """Measured points of every edge. `ideal`: without distortion, (T, 4, ALONG, 2); `good`: (T, 4, ALONG)."""

    ideal: Array
    good: NDArray[np.bool_]


def refine_tags(gray: Gray, quads: Array, intrinsics: Intrinsics) -> tuple[Array, NDArray[np.bool_]]:
    """Better corners of tags.

    Args:
        gray: the picture. Shape (H, W).
        quads: corners of each tag as detected, in their order around the tag [px]. Shape (T, 4, 2).
        intrinsics: of the stream.

    Returns:
        Corners (T, 4, 2) [px], distorted as in the picture, and which tags have four clean edges (T,).
    """
    corners, clean = quads.astype(np.float64), np.ones(len(quads), dtype=np.bool_)
    for _ in range(ROUNDS):
        ideal, fine = _corners(_edges(gray, corners, intrinsics))
        new = _distorted(ideal, intrinsics)
        clean = fine & (np.abs(new - quads).max(axis=(1, 2)) < _reach(quads))
        corners = np.where(clean[:, None, None], new, corners)
    return corners, clean


def _reach(quads: Array) -> Array:
    """How far from an edge its profiles go: most of a module, at most 4 px. Shape (T,)."""
    sides = np.linalg.norm(quads - np.roll(quads, -1, axis=1), axis=2)
    return np.asarray(np.clip(0.8 * sides.min(axis=1) / MODULES, 1.5, 4.0))


def _edges(gray: Gray, corners: Array, intrinsics: Intrinsics) -> _Edges:
    """Where grey changes most across each edge: the centroid of the slope along profiles."""
    cv2 = opencv()
    start, end = corners, np.roll(corners, -1, axis=1)
    direction = end - start
    normal = np.stack([direction[..., 1], -direction[..., 0]], axis=-1)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
    share = np.linspace(FROM_CORNER, 1 - FROM_CORNER, ALONG)
    middle = start[:, :, None] + share[:, None] * direction[:, :, None]
    across = np.linspace(-1, 1, ACROSS) * _reach(corners)[:, None]
    at = middle[:, :, :, None] + across[:, None, None, :, None] * normal[:, :, None, None]
    flat = at.reshape(len(corners), -1, 2).astype(np.float32)
    values = cv2.remap(gray, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    profile = values.reshape(at.shape[:-1]).astype(np.float64)
    slope = np.diff(profile, axis=-1)
    rising = profile[..., -1].mean(axis=-1) > profile[..., 0].mean(axis=-1)
    slope = np.maximum(np.where(rising[..., None, None], slope, -slope), 0.0)
    slope = np.maximum(slope - 0.15 * slope.max(axis=-1, keepdims=True), 0.0)
    between = (across[:, 1:] + across[:, :-1]) / 2
    offset = (slope * between[:, None, None]).sum(axis=-1) / np.maximum(slope.sum(axis=-1), 1e-9)
    points = middle + offset[..., None] * normal[:, :, None]
    good = np.ptp(profile, axis=-1) > LEAST_CONTRAST
    return _Edges(undistort(points.reshape(-1, 2), intrinsics).reshape(points.shape), good)


def _corners(edges: _Edges) -> tuple[Array, NDArray[np.bool_]]:
    """Where neighbouring lines meet (T, 4, 2), without distortion, and which tags have four clean edges (T,)."""
    weight = edges.good.astype(np.float64)
    for _ in range(3):
        total = np.maximum(weight.sum(axis=-1), 1e-9)
        centre = (weight[..., None] * edges.ideal).sum(axis=-2) / total[..., None]
        off = edges.ideal - centre[..., None, :]
        spread = np.einsum("tea,teai,teaj->teij", weight, off, off)
        normal = np.linalg.eigh(spread)[1][..., 0]
        distance = np.abs(np.einsum("teai,tei->tea", off, normal))
        typical = np.median(np.where(edges.good, distance, np.inf), axis=-1)
        weight = edges.good * (distance <= np.maximum(3.5 * typical, 0.05)[..., None])
    kept = weight.sum(axis=-1)
    rms = np.sqrt((weight * distance**2).sum(axis=-1) / np.maximum(kept, 1))
    clean = ((kept >= ALONG // 2) & (rms < MAX_OFF_LINE)).all(axis=1)
    before, level = np.roll(normal, 1, axis=1), np.einsum("tei,tei->te", normal, centre)
    crossing = before[..., 0] * normal[..., 1] - before[..., 1] * normal[..., 0]
    crossing = np.where(np.abs(crossing) < 1e-3, np.inf, crossing)
    earlier = np.roll(level, 1, axis=1)
    u = (earlier * normal[..., 1] - level * before[..., 1]) / crossing
    v = (level * before[..., 0] - earlier * normal[..., 0]) / crossing
    return np.stack([u, v], axis=-1), clean


def _distorted(ideal: Array, intrinsics: Intrinsics) -> Array:
    """The same points as the lens shows them. Shape (..., 2)."""
    K = intrinsics
    x, y = (ideal[..., 0] - K.cx) / K.fx, (ideal[..., 1] - K.cy) / K.fy
    return project(K, np.stack([x, y, np.ones_like(x)], axis=-1))
