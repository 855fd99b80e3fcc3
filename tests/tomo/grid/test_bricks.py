"""Voxels brick by brick: every one has its place, and neighbours stand together."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tomo import ActiveVoxels, Projector, Rays, VoxelGrid
from tomo.grid.active_voxels import brick_order
from tomo.trace import trace

side = st.integers(1, 20)


@given(st.tuples(side, side, side), st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_every_chosen_voxel_has_a_place_of_its_own(shape, seed, share):
    mask = np.random.default_rng(seed).random(shape) < share
    places = brick_order(mask)
    np.testing.assert_array_equal(np.sort(places), np.arange(mask.sum()))


@given(st.tuples(side, side, side), st.integers(0, 2**32 - 1))
def test_bricks_are_gone_through_one_after_another(shape, seed):
    mask = np.random.default_rng(seed).random(shape) < 0.5
    voxels = np.argwhere(mask)[np.argsort(brick_order(mask))]
    bricks = voxels // 8
    flat = np.ravel_multi_index(tuple(bricks.T), (3, 3, 3))
    assert (np.diff(flat) >= 0).all()


def test_in_a_brick_halves_follow_halves():
    places = brick_order(np.ones((8, 8, 8), np.bool_)).reshape(8, 8, 8)
    x, y, z = np.indices((8, 8, 8))
    expected = sum(
        4 * (x >> bit & 1) + 2 * (y >> bit & 1) + (z >> bit & 1) << 3 * bit for bit in range(3)
    )
    np.testing.assert_array_equal(places, expected)


def test_few_unknowns_stay_in_their_order():
    assert ActiveVoxels(VoxelGrid((16, 16, 16), 1.0)).storage_index is None
    assert ActiveVoxels(VoxelGrid((16, 16, 17), 1.0)).storage_index is not None


@pytest.fixture(scope="module", params=[False, True], ids=["all voxels", "active voxels"])
def many(request):
    """Crossings of random rays with a grid of more than a few voxels, and which are active."""
    grid = VoxelGrid((21, 30, 17), 0.5)
    generator = np.random.default_rng(3)
    ends = generator.uniform(-12, 12, (2, 900, 3))
    rays = Rays.from_lines(ends[0], ends[1] - ends[0])
    active = ActiveVoxels(grid)
    if request.param:
        active = ActiveVoxels.from_mask(grid, generator.random(grid.shape) < 0.6)
    segments = trace(rays, grid, dtype=np.float64, active=active)
    assert active.storage_index is not None
    return segments, active


def test_products_are_those_of_the_rows(many):
    segments, active = many
    operator = Projector(segments, active.grid, active=active)
    generator = np.random.default_rng(4)
    x, y = generator.standard_normal(active.size), generator.standard_normal(segments.n_pixels)
    row = np.repeat(np.arange(segments.n_pixels), np.diff(segments.ptr))
    forward = np.bincount(row, segments.length * x[segments.voxel], segments.n_pixels)
    adjoint = np.bincount(segments.voxel, segments.length * y[row], active.size)
    np.testing.assert_allclose(operator @ x, forward, atol=1e-12)
    np.testing.assert_allclose(operator.T @ y, adjoint, atol=1e-12)


def test_segments_come_back_as_they_were_given(many):
    segments, active = many
    operator = Projector(segments, active.grid, [0, 500, 900], active)
    np.testing.assert_array_equal(operator.segments.voxel, segments.voxel)
    assert operator.segments.length is segments.length or np.shares_memory(
        operator.segments.length, segments.length
    )
    second = segments.rows(500, 900)
    np.testing.assert_array_equal(operator.view(1).segments.voxel, second.voxel)
    np.testing.assert_array_equal(operator.view(1).segments.ptr, second.ptr)
    assert abs(operator.to_scipy() - _matrix(segments, active.size)).max() == 0


def test_other_lengths_are_of_the_same_voxels(many):
    segments, active = many
    operator = Projector(segments, active.grid, [0, 500, 900], active).take(np.arange(0, 900, 3))
    length = np.random.default_rng(5).standard_normal(len(operator.segments))
    other = operator.with_lengths(length)
    given = operator.segments
    anew = Projector(replace(given, length=length), active.grid, operator.view_ptr, active)
    np.testing.assert_array_equal(other.view_ptr, operator.view_ptr)
    np.testing.assert_array_equal(other.segments.voxel, given.voxel)
    x = np.random.default_rng(6).standard_normal(active.size)
    np.testing.assert_array_equal(other @ x, anew @ x)


def _matrix(segments, unknowns):
    from scipy.sparse import csr_array

    shape = segments.n_pixels, unknowns
    return csr_array((segments.length, segments.voxel, segments.ptr), shape=shape)
