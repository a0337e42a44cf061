"""Make the missing interface packages with the pip rosidl generators, CMake, Ninja and the system's compiler."""

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from evg_app.errors import BadInput, MissingExtra
from evg_app.robots.ros2.interfaces import DEFINITIONS, DEPENDENCIES, build_folder

GENERATORS = (
    "rosidl_cmake",
    "rosidl_generator_c",
    "rosidl_typesupport_fastrtps_c",
    "rosidl_typesupport_introspection_c",
    "rosidl_typesupport_c",
    "rosidl_generator_py",
)
TIMEOUT = 1200.0
"""Longest time for one package [s]; a busy core needs about 60 s."""
_BAKED_PYTHON = "/opt/python/cp311-cp311/include/python3.11"
_BAKED_NUMPY = "/opt/python/cp311-cp311/lib/python3.11/site-packages/numpy/_core/include"

_CMAKE = """cmake_minimum_required(VERSION 3.8)
project({package} LANGUAGES C CXX)
set(CMAKE_C_FLAGS "-O0 -w")
set(CMAKE_CXX_FLAGS "-O0 -w")
set(CMAKE_INSTALL_RPATH "$ORIGIN;$ORIGIN/../../..")
find_package(ament_cmake REQUIRED)
{found}
# rclpy needs C and Python only.
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "cpp")
rosidl_generate_interfaces(${{PROJECT_NAME}} {files} DEPENDENCIES {dependencies})
ament_package()
"""
_PACKAGE = """<?xml version="1.0"?>
<package format="3">
  <name>{package}</name><version>0.0.0</version><description>evg-app's subset of {package}</description>
  <maintainer email="evg-app@example.com">evg-app</maintainer><license>MIT</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  {depends}
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


def build(say: Callable[[str], None], force: bool = False) -> Path:
    """Build every package of `DEPENDENCIES` into the cache. Returns the folder.

    Raises:
        MissingExtra: the generators are not installed.
        BadInput: a tool is missing, or a build failed; the message holds its last lines.
    """
    target = build_folder()
    if (target / "complete").is_file() and not force:
        say(f"already built: {target}")
        return target
    prefix = _generators()
    header = Path(sysconfig.get_path("include")) / "Python.h"
    if not header.is_file():
        version = f"{sys.version_info.major}.{sys.version_info.minor}"
        raise BadInput(f"{header} is needed to build ROS interfaces. Run: sudo apt-get install python{version}-dev")
    tools = {name: _tool(name) for name in ("cmake", "ninja", "cc", "c++")}
    _mend(prefix)
    shutil.rmtree(target, ignore_errors=True)
    for package in DEPENDENCIES:
        say(f"building {package} ...")
        with TemporaryDirectory(prefix="evg-ros-") as scratch:
            _build_one(package, Path(scratch), prefix, target, tools)
    (target / "complete").touch()
    say(f"built {', '.join(DEPENDENCIES)} into {target}")
    return target


def _generators() -> Path:
    """The prefix that holds the generators' CMake files."""
    candidates = [Path(sys.prefix), *map(Path, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))]
    for prefix in candidates:
        if (prefix / "share" / "rosidl_generator_py").is_dir():
            return prefix
    raise MissingExtra("rosidl_generator_py", "ros")


def _tool(name: str) -> str:
    """Path of a build tool, beside this Python or in the system."""
    beside = Path(sys.prefix) / "bin" / name
    found = str(beside) if beside.is_file() else shutil.which(name)
    if found is None:
        debian = {"cmake": "cmake", "ninja": "ninja-build"}.get(name, "gcc g++")
        raise BadInput(f"'{name}' is needed to build ROS interfaces. Run: sudo apt-get install {debian}")
    return found


def _mend(prefix: Path) -> None:
    """The wheels carry include paths of the machine they were built on; set them to those of this Python."""
    names = {_BAKED_NUMPY: np.get_include(), _BAKED_PYTHON: sysconfig.get_path("include")}
    for path in (prefix / "share").glob("*/cmake/*.cmake"):
        text = path.read_text(encoding="utf-8")
        if "/opt/python/" not in text:
            continue
        for wrong, right in names.items():
            text = text.replace(wrong, right)
        path.write_text(text, encoding="utf-8")


def _build_one(package: str, scratch: Path, prefix: Path, target: Path, tools: dict[str, str]) -> None:
    """Generate, compile and install one package."""
    source = scratch / package
    shutil.copytree(DEFINITIONS / package, source)
    uses = DEPENDENCIES[package]
    files = sorted(str(path.relative_to(source)) for path in source.rglob("*.*") if path.is_file())
    found = "\n".join(f"find_package({name} REQUIRED)" for name in (*GENERATORS, *uses))
    depends = "".join(f"<depend>{name}</depend>" for name in (*uses, "action_msgs", "service_msgs"))
    cmake = _CMAKE.format(package=package, found=found, files=" ".join(files), dependencies=" ".join(uses))
    (source / "CMakeLists.txt").write_text(cmake, encoding="utf-8")
    (source / "package.xml").write_text(_PACKAGE.format(package=package, depends=depends), encoding="utf-8")
    environment = os.environ | {
        "AMENT_PREFIX_PATH": str(prefix),
        "CMAKE_PREFIX_PATH": str(prefix),
        "PATH": os.pathsep.join((str(Path(sys.prefix) / "bin"), os.environ.get("PATH", ""))),
        "CC": tools["cc"],
        "CXX": tools["c++"],
    }
    configure = [tools["cmake"], "-G", "Ninja", f"-DCMAKE_MAKE_PROGRAM={tools['ninja']}", "-DBUILD_TESTING=OFF"]
    configure += [f"-DPython3_EXECUTABLE={sys.executable}", f"-DCMAKE_INSTALL_PREFIX={target}"]
    _run([*configure, "-S", str(source), "-B", str(scratch / "build")], package, environment)
    _run([tools["ninja"], "-C", str(scratch / "build"), "install"], package, environment)


def _run(command: list[str], package: str, environment: dict[str, str]) -> None:
    """Run a build step; its output only when it fails."""
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=TIMEOUT, check=False)
    except subprocess.TimeoutExpired as error:
        raise BadInput(f"building {package} took longer than {TIMEOUT:g} s. Run: evg-app ros build --force") from error
    if done.returncode != 0:
        tail = "\n".join((done.stdout + done.stderr).strip().splitlines()[-15:])
        raise BadInput(f"building {package} failed:\n{tail}\nRun: ./setup.sh ros   and then: evg-app ros build --force")
