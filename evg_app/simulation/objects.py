"""Objects that scenes are made of: built in (no download), or from any folder of URDFs in VGN's layout.

Built-in objects are divided ONCE AND FOR ALL by name: an object whose sha256 of the name is even belongs to the
training half, otherwise to the test half (`split_of`). Names are `<family>_<seed>` or `blob_<number>`.
"""

import hashlib
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from evg_app.errors import BadInput
from evg_app.geometry import Array
from evg_app.simulation.meshes import load_parts, merged

Split = Literal["train", "test"]
FOLDER_MASS = (0.02, 1.0)
"""Masses of a folder's objects are clamped to this range [kg]; many URDFs assume solid water."""
ANY_SCENE = frozenset({"packed", "pile", "adversarial"})


@dataclass(frozen=True)
class ObjectModel:
    """One rigid thing; its frame is the URDF link's, z up when it stands.

    Attributes:
        name: unique within its set.
        urdf: the file that PyBullet loads.
        collision_mesh, visual_mesh: OBJ files in the object frame [m, at scale 1].
        mass: at scale 1 [kg].
        extents: full side lengths of the visual mesh's box at scale 1 [m].
        kinds: the scene kinds it fits.
        family: what made it.
        compound: the collision mesh's `o` groups are exactly its convex parts.
    """

    name: str
    urdf: Path
    collision_mesh: Path
    visual_mesh: Path
    mass: float
    extents: tuple[float, float, float]
    kinds: frozenset[str] = ANY_SCENE
    family: str = "folder"
    compound: bool = False


def split_of(name: str) -> Split:
    """Which half a built-in object belongs to, for ever."""
    return "train" if hashlib.sha256(name.encode()).digest()[0] % 2 == 0 else "test"


def of_kind(objects: tuple[ObjectModel, ...], kind: str) -> tuple[ObjectModel, ...]:
    """Those objects that fit scenes of `kind`.

    Raises:
        BadInput: none does.
    """
    fitting = tuple(o for o in objects if kind in o.kinds)
    if not fitting:
        raise BadInput(f"none of the {len(objects)} objects fits a '{kind}' scene; use another scene or object set.")
    return fitting


def mesh_extents(path: Path) -> Array:
    """Side lengths of a mesh's bounding box [m]. Shape (3,)."""
    extents: Array = np.ptp(merged(load_parts(path)).vertices, axis=0)
    return extents


def _mesh_of(urdf: Path, link: ElementTree.Element, role: str) -> Path:
    element = link.find(role)
    mesh = None if element is None else element.find("geometry/mesh")
    if element is None or mesh is None or not mesh.get("filename"):
        raise BadInput(
            f"{urdf}: no <{role}> mesh. Expected VGN's layout: NAME.urdf, NAME_visual.obj, NAME_collision.obj."
        )
    origin = element.find("origin")
    numbers = [] if origin is None else f"{origin.get('xyz', '0 0 0')} {origin.get('rpy', '0 0 0')}".split()
    numbers_one = (mesh.get("scale") or "1 1 1").split()
    if any(float(n) != 0.0 for n in numbers) or any(float(n) != 1.0 for n in numbers_one):
        raise BadInput(f"{urdf}: the <{role}> mesh has an origin or a scale. Apply it to the mesh file itself.")
    path = urdf.parent / str(mesh.get("filename"))
    if not path.is_file():
        raise BadInput(f"{urdf}: its {role} mesh {path.name} does not exist. Restore the file or remove the URDF.")
    return path


def _read_urdf(urdf: Path) -> ObjectModel:
    try:
        root = ElementTree.parse(urdf).getroot()
        link = root.find("link")
        mass = None if link is None else link.find("inertial/mass")
        if link is None or mass is None:
            raise BadInput(f"{urdf}: not a URDF with one link and a mass. Repair or remove the file.")
        visual, collision = _mesh_of(urdf, link, "visual"), _mesh_of(urdf, link, "collision")
        kilograms = float(mass.get("value", "nan"))
    except (OSError, ElementTree.ParseError, ValueError) as error:
        raise BadInput(f"{urdf}: not a readable URDF ({error}). Repair or remove the file.") from error
    if not 0.0 < kilograms < 50.0:
        raise BadInput(f"{urdf}: mass {kilograms:g} kg is not usable (allowed: above 0, below 50). Repair the file.")
    load_parts(collision)
    x, y, z = mesh_extents(visual).tolist()
    if not 0.002 < max(x, y, z) < 1.0:
        raise BadInput(f"{visual}: {max(x, y, z):.3g} m long (allowed 0.002 to 1 m); are its units metres?")
    kilograms = min(max(kilograms, FOLDER_MASS[0]), FOLDER_MASS[1])
    return ObjectModel(urdf.stem, urdf, collision, visual, kilograms, (x, y, z))


def objects_from_folder(path: Path) -> tuple[ObjectModel, ...]:
    """Every object of a folder in VGN's layout (`NAME.urdf` beside its meshes), sorted by name.

    Raises:
        BadInput: the folder is missing or has no URDF, or a URDF or mesh is broken (the message names the file).
    """
    if not path.is_dir():
        raise BadInput(f"objects folder {path} does not exist. Give a folder of NAME.urdf files with their meshes.")
    urdfs = sorted(path.glob("*.urdf"))
    if not urdfs:
        raise BadInput(
            f"objects folder {path} holds no .urdf file. Give a folder of NAME.urdf files with their meshes."
        )
    return tuple(_read_urdf(urdf.resolve()) for urdf in urdfs)
