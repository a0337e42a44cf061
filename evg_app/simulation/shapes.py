"""Procedural household shapes, each a function of a random generator: lists of convex blocks, z up [m].

`FAMILIES` is the catalogue. "packed" families stand upright by themselves; "adversarial" ones are flat, thin,
smooth, curved or awkward to hold. Every family may lie in a pile.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evg_app.geometry import Array
from evg_app.simulation import shapes_awkward as awkward
from evg_app.simulation.convex import arc, cuboid, disc_section, shell, stack, turned

Blocks = list[Array]
Rng = np.random.Generator

_SIDES = 10
"""Sectors of a hollow wall: few, since every one is a collision body."""
_LIFT = 0.0008
"""Walls start this far above the floor they stand on [m]: one contact instead of many."""


def box(rng: Rng) -> Blocks:
    """A carton: one side always fits the gripper."""
    return [cuboid([rng.uniform(0.025, 0.062), rng.uniform(0.03, 0.10), rng.uniform(0.05, 0.15)])]


def cube(rng: Rng) -> Blocks:
    """A toy block."""
    side = rng.uniform(0.025, 0.06)
    return [cuboid(side * rng.uniform(0.85, 1.15, 3))]


def can(rng: Rng) -> Blocks:
    """A tin or can."""
    r, h = rng.uniform(0.018, 0.034), rng.uniform(0.05, 0.12)
    return [stack([(0.92 * r, 0.0), (r, 0.03 * h), (r, 0.97 * h), (0.92 * r, h)])]


def bottle(rng: Rng) -> Blocks:
    """A bottle with shoulder, neck and cap."""
    r, h = rng.uniform(0.02, 0.033), rng.uniform(0.11, 0.17)
    neck, shoulder = r * rng.uniform(0.35, 0.5), h * rng.uniform(0.55, 0.7)
    body = stack([(0.93 * r, 0.0), (r, 0.04 * h), (r, shoulder), (neck, shoulder + 0.8 * (r - neck) + 0.01)])
    cap = stack([(1.15 * neck, 0.9 * h), (1.15 * neck, h)])
    return [body, stack([(neck, shoulder), (neck, 0.95 * h)]), cap]


def jar(rng: Rng) -> Blocks:
    """A jar with a lid wider or narrower than its body."""
    r, h = rng.uniform(0.024, 0.035), rng.uniform(0.05, 0.10)
    lid = r * rng.uniform(0.75, 1.05)
    return [
        stack([(0.95 * r, 0.0), (r, 0.1 * h), (r, 0.7 * h), (0.8 * r, 0.82 * h)]),
        stack([(lid, 0.8 * h), (lid, h)]),
    ]


def _vessel(radii: tuple[float, float], height: float, wall: float) -> Blocks:
    r0, r1 = radii
    floor = stack([(r0, 0.0), (r0 + (r1 - r0) * wall / height, wall)])
    return [floor, *shell([(r0 - wall, r0, _LIFT), (r1 - wall, r1, height)], _SIDES)]


def cup(rng: Rng) -> Blocks:
    """A tapered cup, open at the top."""
    r1 = rng.uniform(0.027, 0.038)
    return _vessel((r1 * rng.uniform(0.65, 0.9), r1), rng.uniform(0.06, 0.11), rng.uniform(0.0025, 0.004))


def mug(rng: Rng) -> Blocks:
    """A mug with a handle."""
    r, h = rng.uniform(0.03, 0.042), rng.uniform(0.07, 0.10)
    bar = rng.uniform(0.004, 0.006)
    loop = arc(h * rng.uniform(0.25, 0.32), disc_section(bar, 4), -0.5 * np.pi, 0.5 * np.pi, 4)
    handle = [turned(b, "x", 0.5 * np.pi, (r - 0.002, 0.0, 0.5 * h)) for b in loop]
    return [*_vessel((r * rng.uniform(0.9, 1.0), r), h, rng.uniform(0.003, 0.005)), *handle]


def bowl(rng: Rng) -> Blocks:
    """A round bowl."""
    r, wall = rng.uniform(0.045, 0.065), rng.uniform(0.003, 0.005)
    h, foot = r * rng.uniform(0.55, 0.8), r * rng.uniform(0.4, 0.55)
    mid = foot + 0.72 * (r - foot)
    profile = [(foot - wall, foot, _LIFT), (mid - wall, mid, 0.4 * h), (r - wall, r, h)]
    return [stack([(foot, 0.0), (foot + 0.1 * (mid - foot), wall)]), *shell(profile, _SIDES)]


def tube(rng: Rng) -> Blocks:
    """A pipe, open at both ends."""
    r, wall, h = rng.uniform(0.015, 0.033), rng.uniform(0.003, 0.005), rng.uniform(0.05, 0.11)
    return shell([(r - wall, r, 0.0), (r - wall, r, h)], _SIDES)


def basket(rng: Rng) -> Blocks:
    """An open rectangular box."""
    w, d, h, t = rng.uniform(0.045, 0.07), rng.uniform(0.06, 0.10), rng.uniform(0.03, 0.07), rng.uniform(0.003, 0.005)
    sides = [cuboid([w, t, h], [0, s * (d - t) / 2, h / 2 + _LIFT]) for s in (-1, 1)]
    ends = [cuboid([t, d, h], [s * (w - t) / 2, 0, h / 2 + _LIFT]) for s in (-1, 1)]
    return [cuboid([w, d, t], [0, 0, t / 2]), *sides, *ends]


def prism(rng: Rng) -> Blocks:
    """A column with three to eight sides."""
    sides = int(rng.integers(3, 9))
    r, h = rng.uniform(0.02, 0.034), rng.uniform(0.05, 0.12)
    return [stack([(r, 0.0), (r * rng.uniform(0.8, 1.0), h)], sides)]


def spray(rng: Rng) -> Blocks:
    """A spray bottle: flat body, neck and a trigger head."""
    w, d, h = rng.uniform(0.025, 0.04), rng.uniform(0.05, 0.065), rng.uniform(0.08, 0.11)
    body = np.concatenate([cuboid([w, d, 0.7 * h], [0, 0, 0.35 * h]), cuboid([0.6 * w, 0.4 * d, 0.01], [0, 0, h])])
    neck = stack([(0.009, h), (0.009, h + 0.03)], 10)
    head = cuboid([0.018, rng.uniform(0.045, 0.06), 0.016], [0, 0.012, h + 0.034])
    return [body, neck, head]


def house(rng: Rng) -> Blocks:
    """A gabled carton, as milk comes in."""
    w, d, h = rng.uniform(0.035, 0.062), rng.uniform(0.04, 0.065), rng.uniform(0.06, 0.11)
    roof = np.concatenate([cuboid([w, d, 1e-3], [0, 0, h]), cuboid([w, 0.004, 0.012], [0, 0, h + 0.35 * d])])
    return [cuboid([w, d, h], [0, 0, h / 2]), roof]


def stepped(rng: Rng) -> Blocks:
    """Two or three blocks on top of each other."""
    blocks, z, size = [], 0.0, rng.uniform(0.045, 0.062)
    for _ in range(int(rng.integers(2, 4))):
        h = rng.uniform(0.018, 0.035)
        blocks.append(cuboid([size, size * rng.uniform(0.8, 1.1), h], [0, 0, z + h / 2]))
        z, size = z + h, size * rng.uniform(0.55, 0.85)
    return blocks


@dataclass(frozen=True)
class Family:
    """One kind of thing.

    Attributes:
        make: draws its convex blocks [m].
        kinds: scene kinds it fits.
        density: range of the effective density of its material volume [kg/m^3]; containers are mostly air.
        friction: range of its lateral friction.
        rolling: rolling friction [m]; keeps round things from rolling for ever.
    """

    make: Callable[[Rng], Blocks]
    kinds: frozenset[str]
    density: tuple[float, float] = (250.0, 600.0)
    friction: tuple[float, float] = (0.7, 1.0)
    rolling: float = 0.0005


_PACKED = frozenset({"packed", "pile"})
_AWKWARD = frozenset({"pile", "adversarial"})
_THIN = (600.0, 1100.0)
_SMOOTH = (0.5, 0.7)

FAMILIES: dict[str, Family] = {
    "box": Family(box, _PACKED),
    "cube": Family(cube, _PACKED),
    "can": Family(can, _PACKED, rolling=0.001),
    "bottle": Family(bottle, _PACKED, rolling=0.001),
    "jar": Family(jar, _PACKED, rolling=0.001),
    "cup": Family(cup, _PACKED, _THIN, rolling=0.001),
    "mug": Family(mug, _PACKED, _THIN),
    "bowl": Family(bowl, _PACKED | {"adversarial"}, _THIN),
    "tube": Family(tube, _PACKED, _THIN, rolling=0.001),
    "basket": Family(basket, _PACKED, _THIN),
    "prism": Family(prism, _PACKED),
    "spray": Family(spray, _PACKED),
    "house": Family(house, _PACKED),
    "stepped": Family(stepped, _PACKED),
    "card": Family(awkward.card, _AWKWARD, _THIN),
    "plate": Family(awkward.plate, _AWKWARD, _THIN),
    "disc": Family(awkward.disc, _AWKWARD),
    "slab": Family(awkward.slab, _AWKWARD),
    "pen": Family(awkward.pen, _AWKWARD, rolling=0.001),
    "ring": Family(awkward.ring, _AWKWARD, _THIN),
    "ball": Family(awkward.ball, _AWKWARD, friction=_SMOOTH, rolling=0.002),
    "egg": Family(awkward.egg, _AWKWARD, friction=_SMOOTH, rolling=0.002),
    "cone": Family(awkward.cone, _AWKWARD, friction=_SMOOTH, rolling=0.001),
    "wedge": Family(awkward.wedge, _AWKWARD),
    "angle": Family(awkward.angle, _AWKWARD),
    "tee": Family(awkward.tee, _AWKWARD),
    "cross": Family(awkward.cross, _AWKWARD),
    "clamp": Family(awkward.clamp, _AWKWARD),
    "spoon": Family(awkward.spoon, _AWKWARD, _THIN),
    "halfpipe": Family(awkward.halfpipe, _AWKWARD, _THIN, _SMOOTH),
    "dumbbell": Family(awkward.dumbbell, _AWKWARD, rolling=0.001),
    "banana": Family(awkward.banana, _AWKWARD, friction=_SMOOTH),
}
"""Every family by name."""
