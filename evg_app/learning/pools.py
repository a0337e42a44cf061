"""Which objects scenes are made of: training or validation names, never both."""

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.objects import ObjectModel, objects_from_folder

VALIDATION_SHARE = 46
"""Of 256: share of object names held out for validation."""


def is_validation(name: str) -> bool:
    """Whether an object of this name is held out for validation, in whatever folder it lies."""
    return hashlib.sha256(name.encode()).digest()[1] < VALIDATION_SHARE


Pools = dict[str, list[tuple[ObjectModel, ...]]]


@lru_cache(maxsize=4)
def object_pools(packed_folders: tuple[str, ...], pile_folders: tuple[str, ...], validation: bool) -> Pools:
    """For each scene kind the object sets to draw from: built-in first, then the folders' (where there are any).

    Raises:
        BadInput: a folder cannot be used.
    """

    def half(objects: Sequence[ObjectModel]) -> tuple[ObjectModel, ...]:
        """Those on this side of the split."""
        return tuple(o for o in objects if is_validation(o.name) == validation)

    builtin = half(builtin_objects("train"))
    packed = half([o for f in packed_folders for o in objects_from_folder(Path(f))])
    pile = half([o for f in pile_folders for o in objects_from_folder(Path(f))])
    return {
        kind: [tuple(o for o in builtin if kind in o.kinds), *([extra] if extra else [])]
        for kind, extra in (("packed", packed), ("pile", pile), ("adversarial", ()))
    }


def draw_objects(pools: Pools, kind: str, rng: np.random.Generator) -> tuple[ObjectModel, ...]:
    """One set of objects for a scene: built-in, from folders, or (one in ten) both."""
    sets = pools[kind]
    if len(sets) > 1 and rng.random() < 0.1:
        return tuple(o for s in sets for o in s)
    return sets[int(rng.integers(len(sets)))]
