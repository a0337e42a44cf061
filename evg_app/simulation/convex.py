"""Convex building blocks: every procedural object is a list of them, so that PyBullet collides exactly.

A block is an array of corner points, shape (V, 3) [m]; its body is their convex hull.
"""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from evg_app.geometry import Array, rotation_about, transform_points

SECTORS = 16
"""Sides of a block of revolution."""


def cuboid(size: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Corners of an axis-aligned box with full side lengths `size` [m]. Shape (8, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    corners: Array = signs * np.asarray(size) / 2.0 + np.asarray(center)
    return corners


def circle(radius: float, z: float, count: int = SECTORS) -> Array:
    """Points of a horizontal circle about the z axis [m]. Shape (count, 3)."""
    a = 2.0 * np.pi * np.arange(count) / count
    return np.stack([radius * np.cos(a), radius * np.sin(a), np.full(count, z)], axis=1)


def stack(rings: Sequence[tuple[float, float]], count: int = SECTORS) -> Array:
    """One convex solid of revolution through rings of (radius, z) [m]. Shape (rings * count, 3)."""
    return np.concatenate([circle(max(radius, 1e-4), z, count) for radius, z in rings])


def ellipsoid(radii: ArrayLike, levels: int = 8, count: int = SECTORS) -> Array:
    """Points of an ellipsoid with semi-axes `radii` [m]. Shape (V, 3)."""
    polar = np.pi * np.arange(levels + 1) / levels
    unit = stack([(float(np.sin(t)), float(np.cos(t))) for t in polar[1:-1]], count)
    poles = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    points: Array = np.concatenate([unit, poles]) * np.asarray(radii)
    return points


def shell(profile: Sequence[tuple[float, float, float]], count: int = SECTORS) -> list[Array]:
    """Wall of revolution as convex sectors; `profile` lists (inner radius, outer radius, z) from below [m]."""
    parts = []
    for (in0, out0, z0), (in1, out1, z1) in itertools.pairwise(profile):
        rings = [circle(r, z, count) for r, z in ((in0, z0), (out0, z0), (in1, z1), (out1, z1))]
        for k in range(count):
            n = (k + 1) % count
            parts.append(np.concatenate([ring[[k, n]] for ring in rings]))
    return parts


def arc(radius: float, section: Array, start: float, stop: float, count: int) -> list[Array]:
    """A bar bent about the z axis: `section` (S, 2) of (radial, z) offsets [m] swept from `start` to `stop` [rad]."""
    angles = np.linspace(start, stop, count + 1)
    slices = []
    for a in angles:
        r = radius + section[:, 0]
        slices.append(np.stack([r * np.cos(a), r * np.sin(a), section[:, 1]], axis=1))
    return [np.concatenate([s0, s1]) for s0, s1 in itertools.pairwise(slices)]


def disc_section(radius: float, count: int = 8) -> Array:
    """Cross-section of a round bar for `arc`. Shape (count, 2) [m]."""
    a = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return radius * np.stack([np.cos(a), np.sin(a)], axis=1)


def rectangle_section(width: float, height: float) -> Array:
    """Cross-section of a flat bar for `arc`. Shape (4, 2) [m]."""
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2.0, height / 2.0]


def turned(points: Array, axis: str, angle: float, offset: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """`points` turned about a coordinate axis by `angle` [rad], then moved by `offset` [m]. Shape (V, 3)."""
    return transform_points(rotation_about(axis, angle), points) + np.asarray(offset, dtype=np.float64)
