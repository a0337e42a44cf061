"""How long a person waits for the view of a log of many attempts, and for its statistics and report: whole processes.

`python tests/viewer/first_paint.py RUN` with any recorded run; its last attempt stands for all of them.
"""

import argparse
import io
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from browser import Browser
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "trials"))
from big_log import big_log

from evg_app.trials import schema
from evg_app.trials.recorded import RecordedRun

EVG = (sys.executable, "-m", "evg_app.cli.main")
COLORS = 50
"""A drawn scene has more colours than this."""


def with_arrays(folder: Path, run: Path) -> None:
    """Give every attempt the arrays of the last attempt of `run`, and the log the robot of that run."""
    recorded = RecordedRun(run)
    source = run / "attempts" / f"{recorded.attempt_ids[-1]}.npz"
    first = next(iter(recorded.sessions.values()))
    db = schema.open_to_write(folder)
    for row in db.execute("SELECT attempt_id, arrays FROM attempts").fetchall():
        os.link(source, folder / row["arrays"])
    db.execute("UPDATE runs SET config = ?", (json.dumps(first.config),))
    db.execute("UPDATE attempts SET arrays_sha256 = NULL")
    db.close()


def verb(*words: str) -> float:
    """Wall time of a whole process [s]."""
    start = time.perf_counter()
    subprocess.run([*EVG, *words], check=True, stdout=subprocess.DEVNULL)
    return round(time.perf_counter() - start, 2)


def view(folder: Path, profile: Path) -> dict[str, float]:
    """Seconds from the command to its address, and from the address in the browser to what is seen."""
    browser = Browser(profile, "about:blank", "1400,900")
    start = time.perf_counter()
    server = subprocess.Popen([*EVG, "view", str(folder), "--port", "0"], stdout=subprocess.PIPE, text=True)
    try:
        line = server.stdout.readline()
        address, found = line.split(" at ")[1].split()[0], {"command_to_address_s": time.perf_counter() - start}
        start = time.perf_counter()
        browser.open(address)
        browser.until(lambda: "GSR" in browser.text(), "the counters")
        found["counters_s"] = time.perf_counter() - start
        browser.until(lambda: _drawn(browser), "the scene")
        found["scene_drawn_s"] = time.perf_counter() - start
        paint = browser.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime / 1000")
        return {name: round(value, 2) for name, value in {**found, "first_contentful_paint_s": paint}.items()}
    finally:
        server.kill()
        server.wait()
        browser.close()


def _drawn(browser: Browser) -> bool:
    """Whether the left half of the page, where the scene is, has the colours of one."""
    image = np.asarray(Image.open(io.BytesIO(browser.shot())).convert("RGB"))
    half = image[:, : image.shape[1] // 2 : 2].reshape(-1, 3)
    return len(np.unique(half[::7], axis=0)) > COLORS


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--attempts", type=int, default=10_000)
    parser.add_argument("--log", type=Path, help="a folder made before")
    parser.add_argument("--make", action="store_true", help="only make the log")
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as root:
        log = words.log or Path(root) / "run"
        if not log.exists():
            with_arrays(big_log(log, words.attempts), words.run)
        if not words.make:
            facts = {
                "attempts": words.attempts,
                "stats_s": [verb("trials", "stats", str(log)) for _ in range(3)],
                "report_s": [verb("trials", "report", str(log)) for _ in range(2)],
                "view": [view(log, Path(root) / f"profile{i}") for i in range(2)],
            }
            sys.stdout.write(json.dumps(facts, indent=1) + "\n")
