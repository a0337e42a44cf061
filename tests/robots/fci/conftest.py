"""Makes `fci_peers` and `calibrated` importable, and starts each peer once for a module."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from fci_peers import PEERS, Peer


@pytest.fixture(scope="module", params=sorted(PEERS))
def peer(request) -> Iterator[Peer]:
    """Each peer in turn."""
    running = PEERS[request.param]()
    yield running
    running.close()


@pytest.fixture(scope="module")
def strict() -> Iterator[Peer]:
    """The strict peer alone."""
    running = PEERS["franka-sim"]()
    yield running
    running.close()
