"""Where files are kept that can be made again. On its own, as reading it needs no config model."""

import os
from pathlib import Path


def cache_folder() -> Path:
    """Where evg-app may keep files it can make again (`XDG_CACHE_HOME`, else `~/.cache`)."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "evg-app"
