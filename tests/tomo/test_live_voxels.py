"""Unknowns: which voxels they are, and the way to the grid and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tomo.grid import VoxelGrid
from tomo.live_voxels import LiveVoxels
from tomo.viewed import ViewedOperator

GRID = VoxelGrid((2, 3, 4), 0.5)


@given(st.lists(st.booleans(), min_size=24, max_size=24))
def test_the_unknowns_are_the_voxels_of_the_mask(flags):
    live = LiveVoxels.from_mask(GRID, flags)
    values = np.arange(1.0, live.size + 1)
    volume = live.expand(values, fill=np.nan)
    assert np.array_equal(~np.isnan(volume), flags)
    assert np.array_equal(live.compress(volume), values)
    assert np.array_equal(live.mask, np.reshape(flags, GRID.shape))
    assert np.array_equal(volume[live.number >= 0], values[live.number[live.number >= 0]])
    assert live.all == all(flags)


@given(st.lists(st.booleans(), min_size=24, max_size=24))
def test_the_box_holds_the_unknowns_and_a_layer_around_them(flags):
    grid = VoxelGrid((4, 3, 2), 1.0)
    live = LiveVoxels.from_mask(grid, flags)
    values = np.arange(1.0, live.size + 1)
    box = live.box.expand(values)
    assert box.shape == (live.box.grid.size,)
    box = box.reshape(live.box.grid.shape)
    assert np.array_equal(live.box.compress(box), values)
    assert np.array_equal(live.box.mask, box > 0)
    if any(flags):
        places = np.argwhere(live.mask)
        low = np.maximum(places.min(axis=0) - 1, 0)
        high = np.minimum(places.max(axis=0) + 2, grid.shape)
        around = tuple(slice(*ends) for ends in zip(low, high, strict=True))
        assert np.array_equal(box, live.expand(values).reshape(grid.shape)[around])


def test_nothing_is_copied_when_all_are_live():
    volume = np.zeros(24)
    assert np.shares_memory(LiveVoxels(GRID).expand(volume), volume)
    assert np.shares_memory(LiveVoxels(GRID).compress(volume.reshape(GRID.shape)), volume)


@pytest.mark.parametrize("index", [[3, 1], [1, 1], [-1, 2], [0, 24]])
def test_numbers_that_are_no_voxels_are_refused(index):
    with pytest.raises(ValueError, match="live voxels index: "):
        LiveVoxels(GRID, np.array(index, np.int64))


def test_a_mask_of_another_grid_is_refused():
    with pytest.raises(ValueError, match="found 8 voxels, expected 24"):
        LiveVoxels.from_mask(GRID, np.ones((2, 2, 2)))


def test_an_operator_refuses_unknowns_of_another_grid():
    class Nothing(ViewedOperator):
        n_crossings = 0
        rows = _taken = _matvec = _rmatvec = None

    assert Nothing(5, GRID, None, np.float32, LiveVoxels(GRID, np.array([2, 7]))).shape == (5, 2)
    with pytest.raises(ValueError, match="live: found voxels of"):
        Nothing(5, GRID, None, np.float32, LiveVoxels(VoxelGrid((2, 2, 2), 1.0)))
