"""Where ROS interface packages come from: a ROS installation, pip wheels, or what `evg-app ros build` made."""

import ctypes
import functools
import hashlib
import importlib
import importlib.util
import sys
import sysconfig
from importlib import metadata
from pathlib import Path
from typing import Any

from evg_app.config.cache import cache_folder
from evg_app.errors import BadInput, MissingExtra

DEFINITIONS = Path(__file__).resolve().parent / "interfaces"
"""The .msg, .srv and .action files of the packages that no wheel brings."""
DEPENDENCIES: dict[str, tuple[str, ...]] = {
    "control_msgs": ("builtin_interfaces", "std_msgs", "trajectory_msgs"),
    "controller_manager_msgs": ("builtin_interfaces", "lifecycle_msgs"),
    "franka_msgs": ("geometry_msgs", "sensor_msgs", "std_msgs"),
}
"""The packages that `evg-app ros build` makes, with those they use."""
_GENERATOR = "ros-rosidl-generator-py"


class MissingInterfaces(BadInput):
    """A ROS interface package is not there.

    Attributes:
        package: for example "franka_msgs".
    """

    def __init__(self, package: str) -> None:
        self.package = package
        super().__init__(
            f"the ROS interface package '{package}' is not there. Run: evg-app ros build"
            f"   (on a host with ROS from apt: sudo apt-get install ros-jazzy-{package.replace('_', '-')})"
        )


@functools.cache
def build_folder() -> Path:
    """Where built packages are kept: one folder per Python, generator version, recipe and definitions."""
    digest = hashlib.sha256(Path(__file__).with_name("build.py").read_bytes())
    for path in sorted(DEFINITIONS.rglob("*.*")):
        if path.suffix in (".msg", ".srv", ".action"):
            digest.update(path.name.encode() + path.read_bytes())
    try:
        digest.update(metadata.version(_GENERATOR).encode())
    except metadata.PackageNotFoundError:
        digest.update(b"none")
    digest.update(str(sysconfig.get_config_var("EXT_SUFFIX")).encode())
    return cache_folder() / "ros" / digest.hexdigest()[:16]


def site_packages(prefix: Path) -> Path:
    """The Python folder below a build's prefix."""
    return prefix / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}" / "site-packages"


def is_there(package: str) -> bool:
    """Whether an interface package can be imported, built ones included."""
    _activate()
    return importlib.util.find_spec(package) is not None


def rclpy() -> Any:
    """The rclpy module.

    Raises:
        MissingExtra: it is not installed.
        BadInput: it is there, but its libraries do not load.
    """
    try:
        return importlib.import_module("rclpy")
    except ModuleNotFoundError as error:
        raise MissingExtra("rclpy", "ros") from error
    except ImportError as error:
        raise BadInput(
            f"rclpy does not load: {str(error).splitlines()[0]}. A ROS of another Python on the path does this: "
            "open a shell without `source /opt/ros/.../setup.bash`, or reinstall with ./setup.sh ros"
        ) from error


@functools.cache
def interface(module: str, name: str) -> Any:
    """A message, service or action class: `interface("control_msgs.action", "FollowJointTrajectory")`.

    Raises:
        MissingExtra: rclpy is not installed.
        MissingInterfaces: the package is neither installed nor built.
    """
    rclpy()
    package = module.partition(".")[0]
    if not is_there(package):
        raise MissingInterfaces(package)
    _preload(package)
    return getattr(importlib.import_module(module), name)


def _activate() -> None:
    """Put what was built behind everything that is installed."""
    prefix = build_folder()
    site = str(site_packages(prefix))
    if (prefix / "complete").is_file() and site not in sys.path:
        sys.path.append(site)
        importlib.invalidate_caches()


def _preload(package: str) -> None:
    """Load a built package's libraries by their paths: the middleware asks by name, and then finds them loaded."""
    module = importlib.util.find_spec(package)
    if package in _loaded or module is None or not str(module.origin).startswith(str(build_folder())):
        return
    folder = build_folder() / "lib"
    _loaded[package] = [
        ctypes.CDLL(str(path)) for path in sorted(folder.glob(f"lib{package}__rosidl_typesupport_*.so"))
    ]


_loaded: dict[str, list[ctypes.CDLL]] = {}
