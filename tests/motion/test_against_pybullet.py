"""PyBullet judges our checker: what it calls free must not touch anything."""

import importlib.util
from pathlib import Path

import pytest

SCENES, CONFIGURATIONS = 3, 60
MOST_FALSE_HITS = 0.15


@pytest.fixture(scope="module")
def table():
    spec = importlib.util.spec_from_file_location("confusion", Path(__file__).with_name("confusion.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.confusion(SCENES, CONFIGURATIONS, seed=7)


@pytest.mark.parametrize("what", ["boxes", "voxels", "self"])
def test_nothing_that_we_call_free_touches(table, what):
    assert table[what].sum() == SCENES * CONFIGURATIONS
    assert table[what][0, 1] == 0
    assert table[what][1, 1] > 0


@pytest.mark.parametrize("what", ["boxes", "voxels", "self"])
def test_few_free_configurations_are_called_hits(table, what):
    assert table[what][1, 0] < MOST_FALSE_HITS * table[what].sum()
