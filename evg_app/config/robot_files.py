"""Where a robot's URDF, SRDF and meshes are: `<distribution>:<path>` of an installed data package, or a plain path."""

from importlib import metadata
from pathlib import Path

from evg_app.errors import BadInput

_ROBOTS = {"example-robot-data": "cmeel.prefix/share/example-robot-data/robots"}
"""Installed data packages and the folder in them that paths are relative to."""


def resolve(uri: str) -> Path:
    """Path of a robot file such as `example-robot-data:panda_description/urdf/panda.urdf`.

    A URI without a known package prefix is a path of the file system.

    Raises:
        BadInput: the package is not installed or the file does not exist.
    """
    package, colon, relative = uri.partition(":")
    if not colon or package not in _ROBOTS:
        path = Path(uri)
    else:
        try:
            path = Path(str(metadata.distribution(package).locate_file(_ROBOTS[package]))) / relative
        except metadata.PackageNotFoundError as error:
            raise BadInput(f"'{uri}' needs the package '{package}'. Run: .venv/bin/pip install {package}") from error
    if not path.is_file():
        known = ", ".join(f"{name}:" for name in _ROBOTS)
        raise BadInput(f"robot file '{uri}' does not exist (looked at {path}); give a path or start it with {known}")
    return path.resolve()


def package_folder(urdf: Path) -> Path:
    """Folder that `package://` mesh names of `urdf` are relative to: the parent of its `<package>/...`.

    For a URDF outside an installed data package it is the URDF's own folder.
    """
    for parent in urdf.parents:
        if parent.name in _ROBOTS:
            return parent.parent
    return urdf.parent


def collision_urdf(urdf: Path) -> Path:
    """The primitive collision model `<stem>_collision.urdf` beside a URDF, or the URDF itself when there is none."""
    beside = urdf.with_name(f"{urdf.stem}_collision{urdf.suffix}")
    return beside if beside.is_file() else urdf
