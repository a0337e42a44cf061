"""Which voxels are asked and which grasps stay."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evg_app.geometry import T_GRASP_FLIPPED, rotation_about, translation
from evg_app.grasping import selection

MEAN_TOLERANCE = 1e-5


def test_candidates_lie_within_reach_of_seen_surface_and_inside_the_bounds(grid):
    mask = selection.candidate_mask(grid.values)
    surface = np.argwhere(selection.surface(grid.values)) * 0.0075
    for voxel in np.argwhere(mask)[::97]:
        assert np.linalg.norm(surface - voxel * 0.0075, axis=1).min() <= 0.060 + 1e-9
    assert 3_000 < mask.sum() < 30_000
    assert not mask[:2].any() and not mask[:, -2:].any() and not mask[:, :, :7].any()
    assert mask[:, :, 7].any(), "grasp centres just above the table are asked: flat objects"


def test_a_flat_object_is_as_good_a_reason_to_ask_as_a_tall_one(table_only):
    """Under depth noise a card on the table cannot be told from the table: both count as surface."""
    assert selection.candidate_mask(table_only.values)[20, 20, 7:12].all()


def test_nothing_seen_gives_no_candidates():
    assert not selection.candidate_mask(np.zeros((40, 40, 40), np.float32)).any()


def test_masks_turn_with_the_scene(grid):
    turned = np.rot90(grid.values, 1, axes=(0, 1))
    assert np.array_equal(
        selection.candidate_mask(turned), np.rot90(selection.candidate_mask(grid.values), 1, axes=(0, 1))
    )


def test_smoothing_does_not_leak_from_where_nothing_is_defined():
    where = np.zeros((40, 40, 40), bool)
    where[10:20, 10:20, 10:20] = True
    smoothed = selection.smooth(np.where(where, 0.7, 0.0).astype(np.float32), where)
    assert smoothed[where] == pytest.approx(0.7, abs=MEAN_TOLERANCE)
    assert not smoothed[~where].any()


def test_spread_keeps_the_best_of_each_group():
    values = np.array([0.9, 0.8, 0.7, 0.6, 0.5], np.float32)
    group = np.array([1, 1, 1, 0, 2])
    assert selection.spread(values, group, per_group=2, count=4).tolist() == [0, 1, 3, 4]
    assert selection.spread(values, group, per_group=1, count=2).tolist() == [0, 3]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 60), st.integers(1, 4))
def test_spread_is_a_ranked_selection_without_repeats(seed, count, per_group):
    rng = np.random.default_rng(seed)
    values, group = rng.random(50).astype(np.float32), rng.integers(0, 9, 50)
    kept = selection.spread(values, group, per_group, count)
    assert len(set(kept.tolist())) == len(kept) <= count
    assert (np.diff(values[kept]) <= 0).all()
    assert np.bincount(group[kept]).max() <= per_group


def test_width_mask_keeps_what_the_hand_can_take():
    assert selection.width_mask(np.array([0.005, 0.0099, 0.05, 0.0699, 0.075])).tolist() == [
        False,
        True,
        True,
        True,
        False,
    ]


def test_near_duplicates_go_and_real_alternatives_stay():
    base = translation(0.1, 0.1, 0.1)
    T = np.stack(
        [
            base,
            translation(0.105, 0.1, 0.1),
            base @ T_GRASP_FLIPPED,
            base @ rotation_about("x", 0.8),
            translation(0.13, 0.1, 0.1),
        ]
    )
    kept = selection.suppress(T, np.array([0.9, 0.8, 0.95, 0.7, 0.6]), radius=0.015, angle=0.5)
    assert kept.tolist() == [2, 3, 4]
