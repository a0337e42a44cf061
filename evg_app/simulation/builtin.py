"""Makes the built-in objects once and keeps them in the user's cache folder."""

import hashlib
import json
import shutil
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pybullet_data

from evg_app.config.cache import cache_folder
from evg_app.errors import BadInput
from evg_app.simulation import convex, meshes, shapes, shapes_awkward
from evg_app.simulation.meshes import Mesh, hull, load_parts, merged, obj_text, volume_and_center
from evg_app.simulation.objects import ObjectModel, Split, split_of
from evg_app.simulation.shapes import FAMILIES, Family

SEEDS_PER_FAMILY = 20
"""Members of each procedural family, both halves together."""
BLOB_COUNT = 1000
BLOB_SCALE = 0.015
"""pybullet_data's random objects: how many, and the scale their URDFs apply [m per unit]."""
BLOB_LIMITS = (0.015, 0.070, 0.160, 16)
"""Blobs used: smallest side from/to [m], largest side up to [m], convex parts up to."""
MASS_LIMITS = (0.02, 0.40)
"""Every built-in mass is clamped to this range [kg]."""

_BLOB = Family(lambda rng: [], frozenset({"pile"}), density=(200.0, 500.0))

_URDF = """<robot name="{name}">
  <link name="base_link">
    <contact>
      <lateral_friction value="{friction:.3f}"/>
      <rolling_friction value="{rolling:.5f}"/>
      <spinning_friction value="{rolling:.5f}"/>
    </contact>
    <inertial>
      <mass value="{mass:.4f}"/>
      <inertia ixx="{ixx:.3e}" ixy="0" ixz="0" iyy="{iyy:.3e}" iyz="0" izz="{izz:.3e}"/>
    </inertial>
    <visual>
      <geometry><mesh filename="{name}_visual.obj"/></geometry>
      <material name="{name}"><color rgba="{color}"/></material>
    </visual>
    <collision><geometry><mesh filename="{name}_collision.obj"/></geometry></collision>
  </link>
</robot>
"""


def generator_hash() -> str:
    """Hash of the code that makes the objects: a change makes a new cache folder."""
    digest = hashlib.sha256()
    for source in (__file__, convex.__file__, meshes.__file__, shapes.__file__, shapes_awkward.__file__):
        digest.update(Path(source).read_bytes())
    return digest.hexdigest()[:16]


def _seed_of(name: str) -> int:
    return int.from_bytes(hashlib.sha256(f"shape {name}".encode()).digest()[:8], "little")


def _write(folder: Path, name: str, family: str, traits: Family, parts: tuple[Mesh, ...]) -> dict[str, Any]:
    rng = np.random.default_rng(_seed_of(f"{name} material"))
    volume, center = volume_and_center(parts)
    parts = tuple(Mesh(m.vertices - center, m.faces) for m in parts)
    mass = float(np.clip(volume * rng.uniform(*traits.density), *MASS_LIMITS))
    side = np.ptp(merged(parts).vertices, axis=0)
    ixx, iyy, izz = mass / 12.0 * (np.sum(side**2) - side**2)
    color = " ".join(f"{c:.2f}" for c in [*rng.uniform(0.2, 0.95, 3), 1.0])
    text = _URDF.format(
        name=name, friction=rng.uniform(*traits.friction), rolling=traits.rolling, mass=mass,
        ixx=ixx, iyy=iyy, izz=izz, color=color,
    )  # fmt: skip
    mesh = obj_text(parts)
    for file, content in ((".urdf", text), ("_visual.obj", mesh), ("_collision.obj", mesh)):
        (folder / f"{name}{file}").write_text(content, encoding="utf-8")
    return {
        "name": name,
        "family": family,
        "mass": round(mass, 4),
        "extents": side.tolist(),
        "kinds": sorted(traits.kinds),
    }


def _procedural_names() -> list[tuple[str, str]]:
    return [(f"{family}_{seed:02d}", family) for family in FAMILIES for seed in range(SEEDS_PER_FAMILY)]


def _blob_parts(number: int) -> tuple[Mesh, ...] | None:
    path = Path(pybullet_data.getDataPath()) / "random_urdfs" / f"{number:03d}" / f"{number:03d}.obj"
    try:
        raw = load_parts(path)
    except BadInput:
        return None
    side = np.sort(np.ptp(merged(raw).vertices, axis=0)) * BLOB_SCALE
    low, high, longest, count = BLOB_LIMITS
    if not (low < side[0] < high and side[2] < longest and len(raw) <= count):
        return None
    return tuple(hull(m.vertices * BLOB_SCALE) for m in raw)


def _make_all(folder: Path, split: Split) -> None:
    index = []
    for name, family in _procedural_names():
        if split_of(name) == split:
            blocks = FAMILIES[family].make(np.random.default_rng(_seed_of(name)))
            index.append(_write(folder, name, family, FAMILIES[family], tuple(hull(b) for b in blocks)))
    for number in range(BLOB_COUNT):
        name = f"blob_{number:03d}"
        parts = _blob_parts(number) if split_of(name) == split else None
        if parts:
            index.append(_write(folder, name, "blob", _BLOB, parts))
    (folder / "index.json").write_text(json.dumps(index), encoding="utf-8")


def _publish(target: Path, split: Split) -> None:
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{split}-", dir=target.parent))
    except OSError as error:
        raise BadInput(
            f"cannot write the object cache {target.parent} ({error.strerror}). Point XDG_CACHE_HOME elsewhere."
        ) from error
    try:
        _make_all(scratch, split)
        scratch.chmod(0o755)
        scratch.rename(target)
    except OSError:
        if not (target / "index.json").is_file():
            raise
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _model(folder: Path, entry: dict[str, Any]) -> ObjectModel:
    name = entry["name"]
    return ObjectModel(
        name=name,
        urdf=folder / f"{name}.urdf",
        collision_mesh=folder / f"{name}_collision.obj",
        visual_mesh=folder / f"{name}_visual.obj",
        mass=entry["mass"],
        extents=tuple(entry["extents"]),
        kinds=frozenset(entry["kinds"]),
        family=entry["family"],
        compound=True,
    )


@lru_cache(maxsize=4)
def _load(folder: Path) -> tuple[ObjectModel, ...]:
    entries = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    return tuple(sorted((_model(folder, e) for e in entries), key=lambda m: m.name))


def builtin_objects(split: Split) -> tuple[ObjectModel, ...]:
    """Built-in objects of one half, sorted by name; written to the cache folder on first use (a few seconds).

    Raises:
        BadInput: the cache folder cannot be written.
    """
    folder = cache_folder() / "objects" / generator_hash() / split
    if not (folder / "index.json").is_file():
        _publish(folder, split)
    return _load(folder)
