"""Tracing some of the voxels gives what tracing all of them gives there, bit for bit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import Projector
from tomo.rays import Rays
from tomo.trace import TRACERS, trace, tracing

GRIDS = [
    VoxelGrid((30, 41, 26), (0.5, 0.4, 0.6), (3, -2, 1)),
    VoxelGrid((8, 16, 24), 1.0),
    VoxelGrid((1, 90, 3), 0.25, (0, 5, 0)),
    VoxelGrid((17, 1, 1), 2.0),
    VoxelGrid((2, 1, 700), 0.1),  # farther than a byte tells
]
PARTS = ("ptr", "voxel", "length", "midpoint")
grids = st.sampled_from(GRIDS)


def through(grid, n=60, seed=0, pixel_rays=2):
    """Return rays: oblique, along axes, in planes, of finite length, some missing the grid."""
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((n, 3))
    directions[rng.random((n, 3)) < 0.3] = 0
    directions[(directions == 0).all(axis=1)] = [0, 1, 0]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    steps = rng.integers(0, np.add(grid.shape, 1), (n, 3))
    points = np.where(
        rng.random((n, 1)) < 0.5,
        rng.uniform(grid.lower - 1, grid.upper + 1, (n, 3)),
        grid.lower + steps * grid.spacing,
    )
    distance = rng.choice([0, 5, 200], (n, 1))
    lengths = np.where(rng.random(n) < 0.3, distance[:, 0] + rng.uniform(0, 9, n), np.inf)
    ptr = np.append(np.arange(0, n, pixel_rays), n)
    return Rays(points - distance * directions, directions, lengths, rng.uniform(0.2, 1, n), ptr)


def masks(grid, seed):
    """Return active voxels scattered, in one ball, in the outermost layers, one, and none."""
    rng = np.random.default_rng(seed)
    scattered = rng.random(grid.shape) < 10.0 ** rng.uniform(-4, 0)
    away = grid.centers() - rng.uniform(grid.lower, grid.upper)
    ball = (away**2).sum(axis=-1) < (0.2 * grid.extent.max()) ** 2
    shell = np.ones(grid.shape, bool)
    shell[1:-1, 1:-1, 1:-1] = False
    one, none = np.zeros((2, *grid.shape), bool)
    one.flat[rng.integers(grid.size)] = True
    return [scattered, ball, shell, one, none]


def assert_same_in_active_voxels(some, whole, active):
    kept = active.mask.ravel()[whole.voxel]
    pixel = np.repeat(np.arange(whole.n_pixels), np.diff(whole.ptr))
    counts = np.bincount(pixel[kept], minlength=whole.n_pixels)
    np.testing.assert_array_equal(np.diff(some.ptr), counts)
    np.testing.assert_array_equal(some.voxel, active.number[whole.voxel[kept]])
    np.testing.assert_array_equal(some.length, whole.length[kept])
    np.testing.assert_array_equal(some.midpoint, whole.midpoint[kept])
    assert some.voxel.dtype == whole.voxel.dtype
    assert some.length.dtype == some.midpoint.dtype == whole.length.dtype


@settings(max_examples=60)
@given(grids, st.integers(0, 10_000), st.sampled_from([np.float32, np.float64]))
def test_lengths_in_active_voxels_do_not_depend_on_which_others_are_live(grid, seed, dtype):
    rays = through(grid, seed=seed)
    whole = trace(rays, grid, midpoints=True, dtype=dtype)
    for mask in masks(grid, seed):
        active = ActiveVoxels.from_mask(grid, mask)
        some = trace(rays, grid, midpoints=True, dtype=dtype, active=active)
        assert_same_in_active_voxels(some, whole, active)


@pytest.mark.parametrize("tracer", TRACERS)
def test_every_tracer_keeps_to_the_live_voxels(tracer):
    grid = GRIDS[0]
    rays = through(grid, 200, seed=5)
    whole = trace(rays, grid, tracer, midpoints=True)
    for mask in masks(grid, 6):
        active = ActiveVoxels.from_mask(grid, mask)
        some = trace(rays, grid, tracer, midpoints=True, active=active)
        assert_same_in_active_voxels(some, whole, active)
        assert trace(rays, grid, tracer, active=active).midpoint is None


@pytest.mark.parametrize("tracer", TRACERS)
@pytest.mark.parametrize("share", [0.5, 0.05])  # many, and so few that they have no places
def test_unknowns_are_named_by_storage_index_when_asked_for(tracer, share):
    grid = GRIDS[0]
    rays = through(grid, 200, seed=7)
    active = ActiveVoxels.from_mask(grid, np.random.default_rng(8).random(grid.shape) < share)
    plain = trace(rays, grid, tracer, active=active)
    placed = tracing(grid, tracer, active=active, in_storage_order=True)(rays)
    assert (active.storage_index is None) == (share == 0.05)
    expected = plain.voxel if active.storage_index is None else active.storage_index[plain.voxel]
    np.testing.assert_array_equal(placed.voxel, expected)
    assert placed.voxel.dtype == plain.voxel.dtype
    np.testing.assert_array_equal(placed.length, plain.length)
    one, other = (
        Projector(plain, grid, active=active),
        Projector(placed, grid, active=active, in_storage_order=True),
    )
    volume = np.random.default_rng(9).random(active.size)
    np.testing.assert_array_equal(one @ volume, other @ volume)
    np.testing.assert_array_equal(one.column_sums, other.column_sums)
    np.testing.assert_array_equal(one.segments.voxel, other.segments.voxel)


def test_what_a_tracer_found_before_stays_as_it_is():
    grid = GRIDS[0]
    for active in (ActiveVoxels.from_mask(grid, masks(grid, 2)[1]), ActiveVoxels(grid)):
        find = tracing(grid, midpoints=True, active=active)
        for rays in (through(grid, 900, seed=1), through(grid, 60, seed=2)):
            first = find(rays)
            kept = {name: getattr(first, name).copy() for name in PARTS}
            find(through(grid, 700, seed=3))
            alone = trace(rays, grid, midpoints=True, active=active)
            for name, array in kept.items():
                np.testing.assert_array_equal(array, getattr(first, name))
                np.testing.assert_array_equal(array, getattr(alone, name))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_tracer_goes_on_after_rays_that_meet_nothing(dtype):
    grid = GRIDS[0]
    past = Rays.from_lines([[100.0, 0, 0]] * 300, [0, 1, 0])
    none = past.take(np.arange(0))
    for mask in masks(grid, 2):
        active = ActiveVoxels.from_mask(grid, mask)
        find = tracing(grid, midpoints=True, dtype=dtype, active=active)
        for rays in (none, past, through(grid, 600, seed=1), past, none, through(grid, 30)):
            found = find(rays)
            assert found.n_pixels == rays.n_pixels
            alone = trace(rays, grid, midpoints=True, dtype=dtype, active=active)
            for name in PARTS:
                np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))
            assert rays not in (none, past) or len(found) == 0


def test_the_bits_do_not_depend_on_the_number_of_threads(on_threads):
    grid = GRIDS[0]
    active, rays = ActiveVoxels.from_mask(grid, masks(grid, 2)[1]), through(grid, 2000, seed=4)
    found = []
    for threads in (1, 2):
        with on_threads(threads):
            segments = trace(rays, grid, midpoints=True, active=active)
            found.append([getattr(segments, name) for name in PARTS])
    assert len(found[0][1]) > 0
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("tracer", TRACERS)
def test_all_live_is_the_same_as_none_given(tracer):
    grid = GRIDS[1]
    rays = through(grid)
    active = ActiveVoxels.from_mask(grid, np.ones(grid.shape))
    whole = trace(rays, grid, tracer, midpoints=True)
    assert_same_in_active_voxels(
        trace(rays, grid, tracer, midpoints=True, active=active), whole, active
    )


def test_active_voxels_of_another_grid_are_refused():
    with pytest.raises(ValueError, match="active: found voxels of"):
        trace(through(GRIDS[0]), GRIDS[0], active=ActiveVoxels(GRIDS[1]))
