"""Where a run's numbers come from: code, packages, machine, command, configuration."""

import hashlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = (
    *("evg-app", "torch", "onnxruntime", "numpy", "scipy", "pin", "coal", "ompl", "ruckig", "pybullet"),
    *("open3d-cpu", "open3d", "pillow"),
)
"""Packages whose versions can change a result."""


def git_commit(folder: Path | None = None) -> str:
    """Commit of the checkout that holds `folder` (this package by default), "+dirty" when edited, else "unknown"."""
    where = folder or Path(__file__).resolve().parent
    try:
        commit = _git(where, "rev-parse", "HEAD")
        return commit + ("+dirty" if _git(where, "status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return "unknown"


def _git(folder: Path, *words: str) -> str:
    """What a git command says; raises when it fails."""
    done = subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True, timeout=10, check=True)
    return done.stdout.strip()


def provenance() -> dict[str, Any]:
    """Everything about this process that a reader of its results may ask for. JSON."""
    return {
        "git_commit": git_commit(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "machine": platform.node(),
        "cpus": os.cpu_count(),
        "cpu": _cpu(),
        "threads": _threads(),
        "command": sys.argv,
        "packages": {name: found for name in PACKAGES if (found := _version(name))},
    }


def _cpu() -> str:
    """Name of the processor: other vector units round differently."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")


def _threads() -> dict[str, Any]:
    """How many threads numpy's and torch's kernels may use: more of them sum in another order."""
    torch = sys.modules.get("torch")
    return {
        "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", ""),
        "torch": torch.get_num_threads() if torch is not None else None,
    }


def _version(package: str) -> str:
    """Version of a package, empty when it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def canonical(config: Mapping[str, Any]) -> str:
    """JSON with sorted keys: the same text for the same configuration."""
    return json.dumps(config, sort_keys=True, separators=(",", ":"), default=str)


def sha256(text: str) -> str:
    """Hash of a text."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()
