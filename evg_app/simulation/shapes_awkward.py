"""Shapes that are hard to hold: flat, thin, smooth, curved or with no obvious pair of parallel sides [m]."""

import itertools

import numpy as np

from evg_app.geometry import Array
from evg_app.simulation.convex import (
    arc,
    cuboid,
    disc_section,
    ellipsoid,
    rectangle_section,
    shell,
    stack,
    turned,
)

Blocks = list[Array]
Rng = np.random.Generator


def card(rng: Rng) -> Blocks:
    """A deck of cards, a phone: thin but not paper."""
    return [cuboid([rng.uniform(0.05, 0.075), rng.uniform(0.08, 0.13), rng.uniform(0.007, 0.014)])]


def plate(rng: Rng) -> Blocks:
    """A shallow plate with a raised rim."""
    r, wall = rng.uniform(0.045, 0.07), rng.uniform(0.0035, 0.005)
    foot, h = r * rng.uniform(0.55, 0.7), rng.uniform(0.012, 0.02)
    rim = shell([(foot - wall, foot, 0.0008), (r - 2 * wall, r, h)], 10)
    return [stack([(foot, 0.0), (foot, wall)]), *rim]


def disc(rng: Rng) -> Blocks:
    """A puck or coaster."""
    r, h = rng.uniform(0.022, 0.042), rng.uniform(0.009, 0.02)
    return [stack([(r, 0.0), (r, h)], 24)]


def slab(rng: Rng) -> Blocks:
    """A flat bar of soap or chocolate with bevelled edges."""
    w, d, h = rng.uniform(0.035, 0.06), rng.uniform(0.06, 0.11), rng.uniform(0.012, 0.024)
    return [np.concatenate([cuboid([w, d, 0.5 * h]), cuboid([0.85 * w, 0.9 * d, h])])]


def pen(rng: Rng) -> Blocks:
    """A pen or stick, six- or twelve-sided, with a tip."""
    r, length = rng.uniform(0.006, 0.011), rng.uniform(0.10, 0.16)
    sides = int(rng.choice([6, 12]))
    return [turned(stack([(0.3 * r, 0.0), (r, 2.5 * r), (r, length)], sides), "y", 0.5 * np.pi)]


def ring(rng: Rng) -> Blocks:
    """A ring, round or flat in section."""
    outer = rng.uniform(0.025, 0.05)
    bar = rng.uniform(0.005, 0.009)
    section = disc_section(bar, 5) if rng.random() < 0.5 else rectangle_section(2 * bar, 2.4 * bar)
    return arc(outer - bar, section, 0.0, 2.0 * np.pi, 10)


def ball(rng: Rng) -> Blocks:
    """A smooth ball."""
    return [ellipsoid(np.full(3, rng.uniform(0.018, 0.033)), 8, 14)]


def egg(rng: Rng) -> Blocks:
    """A smooth ellipsoid."""
    return [ellipsoid(rng.uniform([0.018, 0.02, 0.028], [0.028, 0.032, 0.05]), 8, 14)]


def cone(rng: Rng) -> Blocks:
    """A cone with a blunt tip."""
    r, h = rng.uniform(0.025, 0.036), rng.uniform(0.04, 0.09)
    return [stack([(r, 0.0), (0.25 * r, h)])]


def wedge(rng: Rng) -> Blocks:
    """A ramp: two sides that are not parallel."""
    w, d, h = rng.uniform(0.03, 0.06), rng.uniform(0.05, 0.09), rng.uniform(0.03, 0.06)
    return [np.concatenate([cuboid([w, d, 2e-3]), cuboid([w, 4e-3, h], [0, -0.5 * d + 2e-3, 0.5 * h])])]


def angle(rng: Rng) -> Blocks:
    """An L-shaped bracket."""
    a, b, t, d = rng.uniform(0.05, 0.09), rng.uniform(0.04, 0.08), rng.uniform(0.012, 0.022), rng.uniform(0.02, 0.045)
    return [cuboid([a, d, t], [a / 2, 0, t / 2]), cuboid([t, d, b], [t / 2, 0, b / 2])]


def tee(rng: Rng) -> Blocks:
    """A T."""
    a, b, t, d = rng.uniform(0.06, 0.10), rng.uniform(0.04, 0.08), rng.uniform(0.012, 0.024), rng.uniform(0.015, 0.03)
    return [cuboid([a, t, d]), cuboid([t, b, d], [0, -b / 2, 0])]


def cross(rng: Rng) -> Blocks:
    """A plus, or a tap handle, with three bars when lucky."""
    a, t = rng.uniform(0.05, 0.085), rng.uniform(0.011, 0.02)
    bars = [cuboid([a, t, t]), cuboid([t, a, t])]
    return bars if rng.random() < 0.5 else [*bars, cuboid([t, t, a])]


def clamp(rng: Rng) -> Blocks:
    """A C-clamp: a frame with a screw through one leg."""
    a, b, t, d = rng.uniform(0.05, 0.085), rng.uniform(0.04, 0.065), rng.uniform(0.010, 0.016), rng.uniform(0.012, 0.02)
    spine = cuboid([t, a, d])
    legs = [cuboid([b, t, d], [b / 2, s * (a - t) / 2, 0]) for s in (-1, 1)]
    screw = turned(stack([(0.006, 0.0), (0.006, 0.6 * a)], 8), "x", -0.5 * np.pi, (b - 0.006, 0.1 * a, 0))
    knob = turned(stack([(0.011, 0.0), (0.011, 0.012)], 10), "x", -0.5 * np.pi, (b - 0.006, 0.7 * a, 0))
    return [spine, *legs, screw, knob]


def spoon(rng: Rng) -> Blocks:
    """A spatula or spoon: a handle and a bent flat end."""
    length, w = rng.uniform(0.08, 0.12), rng.uniform(0.012, 0.018)
    h = rng.uniform(0.009, 0.014)
    end = ellipsoid([rng.uniform(0.022, 0.032), rng.uniform(0.018, 0.026), 0.7 * h], 6, 12)
    blade = turned(end, "y", rng.uniform(-0.3, 0.3), (length / 2 + 0.015, 0, 0))
    return [cuboid([length, w, h]), blade]


def halfpipe(rng: Rng) -> Blocks:
    """A curved shell, like a roof tile."""
    r, wall, h = rng.uniform(0.025, 0.04), rng.uniform(0.004, 0.006), rng.uniform(0.05, 0.10)
    bend = rng.uniform(0.35, 0.6) * np.pi
    tile = arc(r, rectangle_section(wall, h), -bend, bend, 6)
    return [turned(b, "y", -0.5 * np.pi) for b in tile]


def dumbbell(rng: Rng) -> Blocks:
    """Two ends joined by a thin bar."""
    r, bar, length = rng.uniform(0.02, 0.03), rng.uniform(0.007, 0.011), rng.uniform(0.045, 0.07)
    sides = int(rng.choice([6, 16]))
    ends = [stack([(r, z), (r, z + 0.022)], sides) for z in (-length / 2 - 0.022, length / 2)]
    parts = [stack([(bar, -length / 2), (bar, length / 2)], 10), *ends]
    return [turned(p, "y", 0.5 * np.pi) for p in parts]


def banana(rng: Rng) -> Blocks:
    """A bent, tapering fruit."""
    radius, bar, half = rng.uniform(0.06, 0.09), rng.uniform(0.014, 0.019), rng.uniform(0.55, 0.8)
    angles = np.linspace(-half, half, 8)
    section = disc_section(1.0)
    slices = []
    for a in angles:
        s = bar * (1.0 - 0.65 * (abs(a) / half) ** 3) * section
        r = radius + s[:, 0]
        slices.append(np.stack([r * np.cos(a), r * np.sin(a), s[:, 1]], axis=1))
    return [np.concatenate([s0, s1]) for s0, s1 in itertools.pairwise(slices)]
