"""Makes `browser` and `picking_fakes` importable."""

import sys
from pathlib import Path

for folder in (Path(__file__).parent, Path(__file__).parents[1] / "picking"):
    sys.path.insert(0, str(folder))
