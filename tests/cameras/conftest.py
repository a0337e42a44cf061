"""Makes `recordings` and `stand_in` importable, and the recordings that several tests play."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from recordings import FRAMES, table_depth, write_recording


@pytest.fixture(scope="session")
def table_recording(tmp_path_factory) -> Path:
    """`FRAMES` frames of a table with noise, depth and colour, 30 a second."""
    rng = np.random.default_rng(0)
    exact = table_depth()
    depth = [np.rint(exact + rng.normal(0, 2, exact.shape) * (exact > 0)).astype(np.uint16) for _ in range(FRAMES)]
    return write_recording(tmp_path_factory.mktemp("recordings") / "table.db3", depth)
