"""`evg-app doctor`: what is installed, what is missing or unreachable, and the command that mends it."""

import argparse
import ctypes
import importlib
import importlib.util
import json
import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

from evg_app.cli.console import say
from evg_app.cli.finding import Finding
from evg_app.config.cache import cache_folder
from evg_app.config.files import load_camera, load_robot, load_world, shipped_folder
from evg_app.errors import EvgError, HardwareError

CORE = ("numpy", "scipy", "torch", "open3d", "pinocchio", "coal", "ruckig", "pybullet", "trimesh", "safetensors")
LIBRARIES = {
    "libgomp.so.1": "libgomp1",
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
}
EXTRAS = {
    "realsense": ("pyrealsense2", "the D435i camera"),
    "ros": ("rclpy", "the robot over ROS 2"),
    "franka": ("pylibfranka", "the robot over the Franka Control Interface"),
    "viewer": ("viser", "the view in the browser"),
    "export": ("mcap", "evg-app trials export --mcap"),
    "train": ("matplotlib", "curves of evg-app train"),
    "test": ("pytest", "the test-suite"),
}
FREE_SPACE_GB = 2.0


def _import_error(module: str) -> str | None:
    """Why a module cannot be imported, None when it can."""
    try:
        importlib.import_module(module)
    except (ImportError, OSError) as error:
        return str(error).splitlines()[0]
    return None


def check_python() -> Iterator[Finding]:
    """Python 3.11 on a known platform."""
    right = sys.version_info[:2] == (3, 11)
    mend = "" if right else "Run: rm -rf .venv && ./setup.sh   (pybullet and the CPU torch have 3.11 wheels)"
    yield Finding("python", "ok" if right else "fault", f"{platform.python_version()} on {platform.machine()}", mend)


def check_libraries() -> Iterator[Finding]:
    """Shared libraries that the wheels expect of the system."""
    if platform.system() != "Linux":
        return
    for library, package in LIBRARIES.items():
        try:
            ctypes.CDLL(library)
            yield Finding(library, "ok", "found")
        except OSError:
            yield Finding(library, "fault", "not found", f"Run: sudo apt-get install {package}")


def check_core() -> Iterator[Finding]:
    """Packages without which nothing runs."""
    for module in CORE:
        error = _import_error(module)
        if error is None:
            version = str(getattr(sys.modules[module], "__version__", "installed"))
            yield Finding(module, "ok", version)
        else:
            yield Finding(module, "fault", error, "Run: ./setup.sh")


def check_extras() -> Iterator[Finding]:
    """Optional packages, by extra."""
    for extra, (module, purpose) in EXTRAS.items():
        if importlib.util.find_spec(module) is None:
            yield Finding(f"extra {extra}", "note", f"not installed: {purpose}", f"Run: ./setup.sh {extra}")
        else:
            yield Finding(f"extra {extra}", "ok", purpose)


def check_configs() -> Iterator[Finding]:
    """Every shipped config file can be read."""
    loaders: dict[str, Callable[[str], object]] = {"robot": load_robot, "camera": load_camera, "scene": load_world}
    for kind, name in (("robot", "panda"), ("camera", "d435i"), ("scene", "packed"), ("scene", "pile")):
        try:
            loaders[kind](name)
            yield Finding(f"{kind} {name}", "ok", "config reads")
        except EvgError as error:
            yield Finding(f"{kind} {name}", "fault", str(error), f"Restore it from {shipped_folder()} or reinstall")


def check_weights() -> Iterator[Finding]:
    """The shipped weights are complete."""
    from evg_app.grasping.weights import load_weights

    try:
        _, card = load_weights("equiigd")
        yield Finding("weights equiigd", "ok", f"sha256 {card.sha256[:12]}")
    except EvgError as error:
        yield Finding("weights equiigd", "fault", str(error), "Run: git checkout -- evg_app/weights")


def check_storage() -> Iterator[Finding]:
    """Runs and the object cache can be written."""
    cache = cache_folder()
    for name, folder in (("working directory", Path.cwd()), ("cache", cache)):
        existing = next(p for p in (folder, *folder.parents) if p.exists())
        free = shutil.disk_usage(existing).free / 1e9
        if not os.access(existing, os.W_OK):
            yield Finding(name, "fault", f"{existing} is read-only", "Change to a folder you may write, or set HOME")
        elif free < FREE_SPACE_GB:
            yield Finding(name, "fault", f"{free:.1f} GB free", "Free some space: runs need about 1 MB per attempt")
        else:
            yield Finding(name, "ok", f"writable, {free:.0f} GB free")


def check_camera() -> Iterator[Finding]:
    """Whether a RealSense answers."""
    try:
        import pyrealsense2
    except ImportError:
        yield Finding("camera", "note", "cannot look: pyrealsense2 is not installed", "Run: ./setup.sh realsense")
        return
    from evg_app.cameras.realsense.devices import list_cameras, require_any

    try:
        found = require_any(list_cameras(pyrealsense2))
        yield Finding("camera", "ok", ", ".join(f"{info.name} {info.serial} on USB {info.usb}" for info in found))
    except HardwareError as error:
        yield Finding("camera", "note", "no RealSense on USB", str(error))


def check_robot() -> Iterator[Finding]:
    """Whether a robot can be reached over ROS 2: rclpy, interface packages, middleware, domain and range."""
    from evg_app.robots.ros2.interfaces import DEPENDENCIES, is_there
    from evg_app.robots.ros2.network import network

    if importlib.util.find_spec("rclpy") is None:
        yield Finding("robot over ROS 2", "note", "cannot look: rclpy is not installed", "Run: ./setup.sh ros")
        return
    setting = network()
    missing = [package for package in DEPENDENCIES if not is_there(package)]
    mend = "; ".join(setting.faults) or ("Run: evg-app ros build" if missing else "Run: evg-app ros check")
    lacks = f"; missing {', '.join(missing)}" if missing else ""
    yield Finding("robot over ROS 2", "note", f"{setting}{lacks}", mend)


def check_realtime() -> Iterator[Finding]:
    """What the Franka Control Interface asks of this machine; only where its extra is installed."""
    if importlib.util.find_spec("pylibfranka") is None:
        return
    from evg_app.robots.fci.realtime import advice, machine

    found = advice(machine())
    if not found:
        yield Finding("real time", "ok", "PREEMPT_RT, priority allowed")
    for text in found:
        problem, _, mend = text.partition(". ")
        yield Finding("real time", "note", problem, mend or "See docs/franka.md")


CHECKS = (
    check_python,
    check_libraries,
    check_core,
    check_extras,
    check_configs,
    check_weights,
    check_storage,
    check_camera,
    check_robot,
    check_realtime,
)


def findings() -> list[Finding]:
    """Every check, in order; a check that breaks is itself a finding."""
    found: list[Finding] = []
    for check in CHECKS:
        try:
            found.extend(check())
        except Exception as error:  # a doctor must survive what it examines
            found.append(Finding(check.__name__, "fault", f"{type(error).__name__}: {error}", "Run: ./setup.sh"))
    return found


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("doctor", help="say what is installed, missing or unreachable, and how to mend it")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the findings as JSON")
    parser.add_argument(
        "--camera", nargs="?", const="d435i", metavar="NAME", help="open this camera and judge its depth (d435i)"
    )
    parser.add_argument("--serial", default="", metavar="S", help="with --camera: which of several cameras")
    parser.add_argument("--replay", type=Path, metavar="PATH", help="with --camera: a recording or run folder instead")
    parser.add_argument("--robot", default="panda", metavar="NAME", help="with --camera: whose calibration is used")
    parser.add_argument("--config-dir", type=Path, metavar="DIR", help="your own robot_configs/ and calibration/")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the findings. Returns 0 when evg-app can run in simulation (or with `--camera` the camera can), else 2."""
    if args.camera:
        return _run_camera(args)
    found = findings()
    for finding in found:
        _print(finding)
    if args.json:
        args.json.write_text(json.dumps([asdict(f) for f in found], indent=2) + "\n")
    faults = sum(f.status == "fault" for f in found)
    say(f"{faults} fault(s); " + ("evg-app run --sim cannot run" if faults else "evg-app run --sim can run"))
    return 2 if faults else 0


def _print(finding: Finding) -> None:
    """Write a finding for a person."""
    mark = {"ok": "ok   ", "note": "note ", "fault": "FAULT"}[finding.status]
    say(f"{mark}  {finding.check:<18} {finding.detail}")
    if finding.mend:
        say(f"       {'':<18} -> {finding.mend}")


def _run_camera(args: argparse.Namespace) -> int:
    """Open the camera and judge it; every finding is printed as it comes. Returns 0, or 4 when it cannot be used."""
    from evg_app.cli.camera_check import examine

    found = []
    for finding in examine(args):
        _print(finding)
        found.append(finding)
    if args.json:
        args.json.write_text(json.dumps([asdict(f) for f in found], indent=2) + "\n")
    faults = sum(f.status == "fault" for f in found)
    say(f"{faults} fault(s); camera '{args.camera}' " + ("cannot be used yet" if faults else "can be used"))
    return HardwareError.exit_code if faults else 0
