"""Unknowns: which voxels they are, and the way to the grid and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.grid.active_voxels import FARTHEST
from tomo.operators.operator import ProjectionOperator

GRID = VoxelGrid((2, 3, 4), 0.5)


@given(st.lists(st.booleans(), min_size=24, max_size=24))
def test_the_unknowns_are_the_voxels_of_the_mask(flags):
    active = ActiveVoxels.from_mask(GRID, flags)
    values = np.arange(1.0, active.size + 1)
    volume = active.expand(values, fill=np.nan)
    assert np.array_equal(~np.isnan(volume), flags)
    assert np.array_equal(active.compress(volume), values)
    assert np.array_equal(active.mask, np.reshape(flags, GRID.shape))
    assert np.array_equal(volume[active.number >= 0], values[active.number[active.number >= 0]])
    assert active.all == all(flags)


@given(st.lists(st.booleans(), min_size=24, max_size=24))
def test_the_box_holds_the_unknowns_and_a_layer_around_them(flags):
    grid = VoxelGrid((4, 3, 2), 1.0)
    active = ActiveVoxels.from_mask(grid, flags)
    values = np.arange(1.0, active.size + 1)
    box = active.box.expand(values)
    assert box.shape == (active.box.grid.size,)
    box = box.reshape(active.box.grid.shape)
    assert np.array_equal(active.box.compress(box), values)
    assert np.array_equal(active.box.mask, box > 0)
    if any(flags):
        places = np.argwhere(active.mask)
        low = np.maximum(places.min(axis=0) - 1, 0)
        high = np.minimum(places.max(axis=0) + 2, grid.shape)
        around = tuple(slice(*ends) for ends in zip(low, high, strict=True))
        assert np.array_equal(box, active.expand(values).reshape(grid.shape)[around])


def test_nothing_is_copied_when_all_are_active():
    volume = np.zeros(24)
    assert np.shares_memory(ActiveVoxels(GRID).expand(volume), volume)
    assert np.shares_memory(ActiveVoxels(GRID).compress(volume.reshape(GRID.shape)), volume)


@pytest.mark.parametrize("index", [[3, 1], [1, 1], [-1, 2], [0, 24]])
def test_numbers_that_are_no_voxels_are_refused(index):
    with pytest.raises(ValueError, match="active voxels index: "):
        ActiveVoxels(GRID, np.array(index, np.int64))


def test_a_mask_of_another_grid_is_refused():
    with pytest.raises(ValueError, match="found 8 voxels, expected 24"):
        ActiveVoxels.from_mask(GRID, np.ones((2, 2, 2)))


def test_an_operator_refuses_unknowns_of_another_grid():
    class Nothing(ProjectionOperator):
        n_segments = 0
        rows = _taken = _matvec = _rmatvec = None

    assert Nothing(5, GRID, None, np.float32, ActiveVoxels(GRID, np.array([2, 7]))).shape == (5, 2)
    with pytest.raises(ValueError, match="active: found voxels of"):
        Nothing(5, GRID, None, np.float32, ActiveVoxels(VoxelGrid((2, 2, 2), 1.0)))


@pytest.mark.parametrize("shape", [(1, 1, 1), (5, 1, 9), (8, 11, 6)])
def test_the_distance_is_the_largest_difference_along_an_axis(shape):
    random = np.random.default_rng(len(shape))
    mask = random.random(shape) < 0.05
    mask.flat[0] = True
    voxels, active = np.indices(shape).reshape(3, -1), np.argwhere(mask)
    expected = np.abs(voxels.T[:, None] - active).max(axis=2).min(axis=1).reshape(shape)
    found = ActiveVoxels.from_mask(VoxelGrid(shape, 1.0), mask).distance
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, expected)


def test_distances_end_at_the_largest_that_a_byte_holds():
    grid = VoxelGrid((2, 3, 700), 1.0)
    mask = np.zeros(grid.shape, np.bool_)
    assert (ActiveVoxels.from_mask(grid, mask).distance == FARTHEST).all()
    mask[1, 1, 0] = True
    found = ActiveVoxels.from_mask(grid, mask).distance
    np.testing.assert_array_equal(found[0, 0], np.clip(np.arange(700), 1, FARTHEST))
