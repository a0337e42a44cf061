"""Run folders: a new one for every run, found again by age."""

from datetime import datetime
from pathlib import Path
from uuid import uuid4

from evg_app.errors import BadInput
from evg_app.trials.schema import DATABASE

RUNS = Path("runs")
"""Where run folders go by default."""
ATTEMPTS = "attempts"
"""Arrays and pictures of the attempts, inside a run folder."""


def default_name() -> Path:
    """`runs/<date>-<time>-<6 hex digits>`."""
    return RUNS / f"{datetime.now():%Y%m%d-%H%M%S}-{uuid4().hex[:6]}"


def make(folder: Path) -> Path:
    """Create a run folder.

    Raises:
        BadInput: it exists with content, or cannot be written.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadInput(f"--run-dir {folder} exists and is not empty; a run never overwrites another. Name a new folder")
    try:
        (folder / ATTEMPTS).mkdir(parents=True)
        probe = folder / ".probe"
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        problem = error.strerror or str(error)
        raise BadInput(f"--run-dir {folder} cannot be written: {problem}. Name a folder you may write to") from error
    return folder


def newest(root: Path = RUNS) -> Path:
    """The run folder under `root` that started last.

    Raises:
        BadInput: there is none.
    """
    runs = sorted(root.glob(f"*/{DATABASE}"), key=lambda path: (path.stat().st_mtime_ns, path.parent.name))
    if not runs:
        raise BadInput(f"no run under {root.resolve()}. Run: evg-app run --sim, or name a run folder")
    return runs[-1].parent
