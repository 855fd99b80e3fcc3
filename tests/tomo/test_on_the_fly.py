"""The projector without a matrix is the stored one, to rounding, and its own transpose."""

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tomo import Projector, Rays, VoxelGrid, dot_test
from tomo.on_the_fly import OnTheFlyProjector
from tomo.trace import trace

GRIDS = [
    VoxelGrid((12, 9, 7), 1.0),
    VoxelGrid((1, 30, 5), (0.5, 2.0, 0.1), (3, -4, 5)),
    VoxelGrid((40, 1, 1), 0.25),
    VoxelGrid((6, 6, 6), 1e-6, (1.0, 2.0, 3.0)),
]


def random_rays(grid, count, seed):
    """Rays through the box from near, far and within, an axis-parallel tenth among them."""
    random = np.random.default_rng(seed)
    target = random.uniform(grid.lower, grid.upper, (count, 3))
    away = random.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    away[: count // 10] = np.eye(3)[random.integers(0, 3, count // 10)]
    distance = grid.extent.max() * 10 ** random.uniform(-1, 4, (count, 1))
    return Rays.from_lines(target + away * distance, -away)


@pytest.fixture(params=range(len(GRIDS)), ids=lambda n: str(GRIDS[n].shape))
def pair(request):
    grid = GRIDS[request.param]
    rays = random_rays(grid, 2000, request.param)
    view_ptr = [0, 700, 700, 2000]
    stored = Projector(trace(rays, grid, "reference", dtype=np.float64), grid, view_ptr)
    return stored, OnTheFlyProjector(rays, grid, view_ptr)


def test_same_matrix_in_double_precision(pair):
    stored, flying = pair
    random = np.random.default_rng(1)
    x, y = random.normal(size=stored.shape[1]), random.normal(size=stored.shape[0])
    scale = stored.row_sums.max()
    assert np.abs(flying @ x - stored @ x).max() < 1e-9 * scale
    back = stored.T @ y
    assert np.abs(flying.T @ y - back).max() < 1e-9 * np.abs(back).max()


def test_chord_lengths_in_single_precision(pair):
    stored, flying = pair
    chord = flying @ np.ones(stored.shape[1], np.float32)
    assert chord.dtype == np.float32
    assert np.abs(chord - stored.row_sums).max() < 1e-5 * stored.row_sums.max()


def test_lengths_of_every_voxel(pair):
    stored, flying = pair
    matrix = stored.to_scipy()
    errors = []
    for voxel in np.random.default_rng(2).integers(0, stored.shape[1], 40):
        unit = np.zeros(stored.shape[1], np.float32)
        unit[voxel] = 1
        exact = matrix[:, [voxel]].toarray().ravel()
        errors.append((flying @ unit - exact) / max(stored.grid.spacing))
    # a face passed at a grazing angle is found less well, but by few rays
    assert np.abs(errors).max() < 1e-4
    assert np.sqrt(np.mean(np.square(errors))) < 1e-6


@pytest.mark.parametrize(("dtype", "bound"), [(np.float64, 1e-12), (np.float32, 1e-6)])
def test_dot_test(pair, dtype, bound):
    _, flying = pair
    for seed in range(5):
        assert dot_test(flying, seed, dtype) < bound
        assert dot_test(flying.subset([2, 0]), seed, dtype) < bound


@given(seed=st.integers(0, 2**31), shape=st.tuples(*[st.integers(1, 9)] * 3))
def test_random_grids(seed, shape):
    random = np.random.default_rng(seed)
    grid = VoxelGrid(shape, tuple(random.uniform(0.2, 3, 3)), tuple(random.normal(size=3)))
    rays = random_rays(grid, 60, seed)
    stored = Projector(trace(rays, grid, "reference", dtype=np.float64), grid)
    x = random.normal(size=grid.size)
    difference = np.abs(OnTheFlyProjector(rays, grid) @ x - stored @ x)
    assert difference.max() < 1e-9 * grid.extent.sum() * np.abs(x).max()


def test_rays_along_faces_are_counted_once():
    grid = VoxelGrid((4, 4, 4), 1.0, (2, 2, 2))
    faces = np.arange(5.0)
    y, z = (a.ravel() for a in np.meshgrid(faces, faces))
    rays = Rays.from_lines(np.stack([np.full(25, -3.0), y, z], 1), [1.0, 0, 0])
    stored = Projector(trace(rays, grid, "reference"), grid)
    flying = OnTheFlyProjector(rays, grid)
    x = np.random.default_rng(0).random(64)
    assert flying @ x == pytest.approx(stored @ x, rel=1e-12)


def test_rays_that_miss_or_end_early():
    grid = VoxelGrid((4, 4, 4), 1.0)
    rays = Rays.from_lines([[-9, 0.5, 0.5], [-9, 50, 0], [0, 0.5, 0.5]], [1.0, 0, 0], [8, 99, 1])
    assert (OnTheFlyProjector(rays, grid) @ np.ones(64)).tolist() == [1.0, 0.0, 1.0]


def test_views_and_pixels(pair):
    stored, flying = pair
    x = np.random.default_rng(3).random(stored.shape[1])
    whole = flying @ x
    assert np.array_equal(flying.view(2) @ x, whole[700:])
    assert np.array_equal(flying.subset([2, 1, 0]) @ x, np.r_[whole[700:], whole[:700]])
    assert flying.subset([2, 1, 0]).view_ptr.tolist() == [0, 1300, 1300, 2000]
    some = np.arange(5, 2000, 7)
    assert np.array_equal(flying.take(some) @ x, whole[some])
    assert flying.n_crossings == pytest.approx(stored.n_crossings, rel=1e-3)


def test_several_rays_a_pixel_are_averaged():
    grid = GRIDS[0]
    one = random_rays(grid, 300, 5)
    weight = np.full(300, 1 / 3)
    grouped = Rays(one.origins, one.directions, one.lengths, weight, np.arange(0, 301, 3))
    x = np.random.default_rng(4).random(grid.size)
    means = (OnTheFlyProjector(one, grid) @ x).reshape(-1, 3).mean(axis=1)
    assert OnTheFlyProjector(grouped, grid) @ x == pytest.approx(means, rel=1e-12)
    assert dot_test(OnTheFlyProjector(grouped, grid)) < 1e-12


def test_same_bits_on_any_number_of_threads(pair):
    _, flying = pair
    random = np.random.default_rng(6)
    x = random.random(flying.shape[1]).astype(np.float32)
    y = random.random(flying.shape[0]).astype(np.float32)
    threads = numba.get_num_threads()
    try:
        results = []
        for count in range(1, threads + 1):
            numba.set_num_threads(count)
            results.append((flying @ x, flying.T @ y))
    finally:
        numba.set_num_threads(threads)
    for images, volume in results[1:]:
        assert np.array_equal(images, results[0][0])
        assert np.array_equal(volume, results[0][1])


@pytest.mark.parametrize("slope", [(1, 1, 0), (1, 1, 0.2), (1, -1, 0), (-1, 1, 1), (0.5, 1, -1)])
@pytest.mark.parametrize("beside", [-(2.0**-53), 0.0, 2.0**-52, -(2.0**-24), 2.0**-23])
def test_diagonal_rays_beside_edges(slope, beside):
    grid = VoxelGrid((4, 4, 4), 1.0, (2, 2, 2))
    starts = [(0, 1 + beside, 1.5), (0, 3 + beside, 2 - beside), (4 + beside, 2, 1 + beside)]
    rays = Rays.from_lines(np.subtract(starts, np.multiply(9.0, slope)), slope)
    stored = Projector(trace(rays, grid, "reference", dtype=np.float64), grid)
    flying = OnTheFlyProjector(rays, grid)
    bounds = {np.float64: 1e-12, np.float32: 1e-5}
    if 0 < abs(beside) < 2.0**-24:  # single precision cannot tell on which side of the edge
        del bounds[np.float32]
    for dtype, bound in bounds.items():
        for voxel in range(grid.size):
            unit = np.zeros(grid.size, dtype)
            unit[voxel] = 1
            assert np.abs(flying @ unit - stored @ unit).max() < bound


def test_a_piece_too_short_to_move_leaves_no_trace():
    grid = VoxelGrid((4, 4, 4), 1.0)
    flying = OnTheFlyProjector(Rays.from_lines([0.3, 0.4, 0.5], [1.0, 0, 0], 1e-20), grid)
    assert (flying @ np.ones(64)).tolist() == [0.0]
    assert not (flying.T @ np.ones(1)).any()
