"""A simulated run on a file system of its own that turns full, or aborts and turns read-only, in mid run. Needs root.

`sudo PYTHONPATH=. python tests/trials/disk_faults.py full|abort`: prints what the run said and what it left.
"""

import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

EVG = (sys.executable, "-m", "evg_app.cli.main")
SIZE = {"full": "3M", "abort": "64M"}


@contextmanager
def mounted(image: Path, folder: Path) -> Iterator[None]:
    """The file system of an image."""
    subprocess.run(["mount", "-o", "loop", image, folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def run(folder: Path, fault: str) -> int:
    """The exit code of a run; with "abort" the file system gives up in its second pass."""
    words = ["run", "--sim", "--model", "antipodal", "--seed", "100", "--rounds", "4", "--run-dir", str(folder)]
    process = subprocess.Popen([*EVG, *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    for line in process.stdout:
        sys.stdout.write(line)
        if fault == "abort" and "pass 0" in line:
            subprocess.run(["mount", "-o", "remount,abort", folder.parent], check=True)
            fault = "aborted"
    return process.wait()


def left(database: Path) -> tuple[str, int]:
    """What SQLite's integrity check says, and how many finished attempts there are."""
    db = sqlite3.connect(database)
    try:
        sound = db.execute("PRAGMA integrity_check").fetchone()[0]
        return sound, db.execute("SELECT COUNT(*) FROM attempts WHERE outcome IS NOT NULL").fetchone()[0]
    finally:
        db.close()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as root:
        image, folder = Path(root) / "image", Path(root) / "disk"
        folder.mkdir()
        subprocess.run(["truncate", "-s", SIZE[sys.argv[1]], image], check=True)
        subprocess.run(["mkfs.ext4", "-q", "-F", image], check=True)
        with mounted(image, folder):
            code = run(folder / "run", sys.argv[1])
        subprocess.run(["fsck.ext4", "-pf", image], check=False, stdout=subprocess.DEVNULL)
        with mounted(image, folder):
            sys.stdout.write(f"exit {code}; afterwards {left(folder / 'run' / 'trials.sqlite')}\n")
