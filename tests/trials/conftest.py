"""Makes `picking_fakes` and `kill_harness` importable."""

import sys
from pathlib import Path

for folder in (Path(__file__).parent.parent / "picking", Path(__file__).parent):
    sys.path.insert(0, str(folder))
