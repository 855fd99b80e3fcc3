import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.linalg import LinearOperator

import rigs
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import Projector, dot_test
from tomo.rays import Rays
from tomo.trace import Segments, trace

GRID = VoxelGrid((9, 14, 7), (0.5, 0.4, 0.6), (0.3, -0.2, 0.1))
DTYPES = pytest.mark.parametrize("dtype", [np.float32, np.float64])
SIZES = [(20, 26), (14, 30), (18, 18)]  # of three cameras that differ


def make(length_dtype=np.float32, supersample=2):
    """Return the projector of three unlike cameras; some pixels look past the grid."""
    rig = rigs.ring(3, distance=40, image_size=(20, 30), focal_length=100, pixel_pitch=1)
    views = [
        Rays.from_camera(camera.cropped(0, 0, *size), supersample=supersample)
        for camera, size in zip(rig, SIZES, strict=True)
    ]
    segments = trace(Rays.concatenate(views), GRID, dtype=length_dtype)
    return Projector(segments, GRID, np.cumsum([0, *(v.n_pixels for v in views)]))


@pytest.fixture(scope="module")
def projector():
    return make()


@pytest.fixture(scope="module")
def derived(projector):
    """The projector and everything that is made from it."""
    every_third = np.arange(0, projector.shape[0], 3)
    return {
        "whole": projector,
        "lengths in float64": make(np.float64),
        "subset": projector.subset([2, 0]),
        "take": projector.take(every_third),
        "view": projector.view(1),
        "rows": projector.rows(100, 700),
        "take of subset": projector.subset([1, 2]).take(np.arange(5, 600, 7)),
    }


NAMES = pytest.mark.parametrize(
    "name", ["whole", "lengths in float64", "subset", "take", "view", "rows", "take of subset"]
)


def volume(seed=0, dtype=np.float64):
    return np.random.default_rng(seed).standard_normal(GRID.size).astype(dtype)


def images(operator, seed=0, dtype=np.float64):
    return np.random.default_rng(seed).standard_normal(operator.shape[0]).astype(dtype)


@pytest.mark.parametrize("wrong", ["shifted", "scaled", "rounded"])
def test_the_dot_test_sees_an_adjoint_that_does_not_match(projector, wrong):
    matrix = projector.to_scipy().tocsr()
    other = {
        "shifted": lambda: scipy.sparse.csr_array(np.roll(matrix.toarray(), 1, axis=1)),
        "scaled": lambda: matrix * (1 + 1e-5),
        "rounded": lambda: scipy.sparse.csr_array(matrix.toarray().round(3)),
    }[wrong]()
    operator = LinearOperator(
        matrix.shape, matvec=lambda x: matrix @ x, rmatvec=lambda y: other.T @ y, dtype=float
    )
    assert max(dot_test(operator, seed) for seed in range(5)) > 1e-8
    right = LinearOperator(
        matrix.shape, matvec=lambda x: matrix @ x, rmatvec=lambda y: matrix.T @ y, dtype=float
    )
    assert max(dot_test(right, seed) for seed in range(5)) < 1e-12


@NAMES
@DTYPES
def test_products_are_those_of_the_matrix(derived, name, dtype):
    operator = derived[name]
    matrix = operator.to_scipy().astype(np.float64)
    assert matrix.shape == operator.shape == (operator.segments.n_pixels, GRID.size)
    x, y = volume(1, dtype), images(operator, 2, dtype)
    y[::5] = 0  # rows of dark pixels are skipped
    assert (operator @ x).dtype == (operator.T @ y).dtype == dtype
    close = {"rtol": 0, "atol": 1e-12 if dtype == np.float64 else 1e-5}
    np.testing.assert_allclose(operator @ x, matrix @ x.astype(float), **close)
    np.testing.assert_allclose(operator.T @ y, matrix.T @ y.astype(float), **close)
    np.testing.assert_array_equal(operator.rmatvec(y), operator.T @ y)
    columns = np.stack([x, volume(3, dtype)], axis=1)
    np.testing.assert_allclose(operator @ columns, matrix @ columns.astype(float), **close)


def test_whole_numbers_are_projected_in_double_precision(projector):
    ones = np.ones(GRID.size, int)
    assert (projector @ ones).dtype == np.float64
    np.testing.assert_array_equal(projector @ ones, projector.row_sums)


def test_sums_over_a_pixel_are_in_double_precision():
    """A million small terms beside a large one: single precision would lose them all."""
    n = 2**20
    length = np.full(n, 2.0**-26, np.float32)
    length[0] = 1
    one = VoxelGrid((1, 1, 1), 1.0)
    forward = Projector(Segments(np.array([0, n]), np.zeros(n, np.int32), length), one)
    assert (forward @ np.ones(1, np.float32))[0] == np.float32(1 + (n - 1) / 2**26)
    adjoint = Projector(Segments(np.arange(n + 1), np.zeros(n, np.int32), length), one)
    assert (adjoint.T @ np.ones(n))[0] == 1 + (n - 1) / 2**26


def test_sums_over_the_pixels_of_a_voxel_are_good_to_single_precision():
    """Two thousand rays through each voxel, as many as a large scan has."""
    n, rng = 2**20, np.random.default_rng(0)
    entries = Segments(
        np.arange(n + 1),
        rng.integers(0, 512, n).astype(np.int32),
        rng.random(n).astype(np.float32),
    )
    adjoint = Projector(entries, VoxelGrid((8, 8, 8), 1.0)).T
    y = rng.random(n).astype(np.float32)
    np.testing.assert_allclose(adjoint @ y, adjoint @ y.astype(np.float64), rtol=1e-6)


@DTYPES
def test_the_number_of_threads_changes_no_bit(projector, dtype, on_threads):
    x, y = volume(4, dtype), images(projector, 5, dtype)
    results = []
    for threads in (1, 2):
        with on_threads(threads):
            again = make()
            results.append((again @ x, again.T @ y, again.segments.length, again.column_sums))
    for one, two in zip(*results, strict=True):
        np.testing.assert_array_equal(one, two)


@NAMES
def test_row_sums_and_column_sums(derived, name):
    operator = derived[name]
    matrix = operator.to_scipy().astype(np.float64)
    np.testing.assert_allclose(operator.row_sums, matrix.sum(axis=1), rtol=1e-12)
    np.testing.assert_allclose(operator.column_sums, matrix.sum(axis=0), rtol=1e-12)
    assert operator.row_sums.dtype == operator.column_sums.dtype == np.float64


def test_view_ptr_says_whose_pixels_stand_where(projector):
    pixels = [w * h for w, h in SIZES]
    assert projector.n_views == 3
    np.testing.assert_array_equal(np.diff(projector.view_ptr), pixels)
    x = volume(6)
    whole = projector @ x
    for view in range(3):
        start, stop = projector.view_ptr[view : view + 2]
        np.testing.assert_array_equal(projector.view(view) @ x, whole[start:stop])
        assert projector.view(view).view_ptr.tolist() == [0, stop - start]


@given(st.lists(st.integers(0, 2), max_size=5))
def test_a_subset_is_the_views_in_the_order_given(projector, views):
    x, y = volume(7), images(projector, 8)
    part = projector.subset(views)
    ptr = projector.view_ptr
    np.testing.assert_array_equal(np.diff(part.view_ptr), [np.diff(ptr)[v] for v in views])
    pixels = projector.pixels_of(views)
    expected = [np.arange(ptr[v], ptr[v + 1]) for v in views]
    np.testing.assert_array_equal(pixels, np.concatenate([[], *expected]))
    np.testing.assert_array_equal(part @ x, (projector @ x)[pixels])
    spread = np.zeros(projector.shape[0])
    np.add.at(spread, pixels, y[pixels])  # a view given twice counts twice
    np.testing.assert_allclose(part.T @ y[pixels], projector.T @ spread, rtol=0, atol=1e-10)


@given(st.sets(st.integers(0, sum(w * h for w, h in SIZES) - 1), max_size=40))
def test_taken_pixels_stay_in_their_views(projector, chosen):
    pixels = np.array(sorted(chosen), np.int64)
    part, x = projector.take(pixels), volume(9)
    np.testing.assert_array_equal(part @ x, (projector @ x)[pixels])
    assert part.n_views == 3
    view = np.searchsorted(projector.view_ptr, pixels, side="right") - 1
    np.testing.assert_array_equal(np.diff(part.view_ptr), np.bincount(view, minlength=3))


def test_views_without_pixels_and_projectors_without_views(projector):
    segments = projector.segments.rows(0, 6)
    gaps = Projector(segments, GRID, [0, 0, 4, 4, 6, 6])
    assert gaps.n_views == 5
    x = volume(10)
    assert [len(gaps.view(v) @ x) for v in range(5)] == [0, 4, 0, 2, 0]
    np.testing.assert_array_equal(gaps.subset([3, 0, 1]).view_ptr, [0, 2, 2, 6])
    for nothing in (gaps.view(0), gaps.subset([]), gaps.take(np.zeros(0, np.int64))):
        assert nothing.shape == (0, GRID.size)
        assert (nothing @ x).shape == (0,)
        np.testing.assert_array_equal(nothing.T @ np.zeros(0), np.zeros(GRID.size))
    assert gaps.subset([]).n_views == 0


def test_projectors_of_some_pixels_copy_no_entries():
    whole = make(supersample=6)
    for some in (lambda: whole.subset([2, 0, 0]), lambda: whole.take(np.arange(0, 900, 2))):
        tracemalloc.start()
        try:
            part = some().subset([1, 0])
            part.view(0)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak < 2 * part.n_segments  # bytes; an entry has eight


@DTYPES
def test_the_columns_are_the_live_voxels(projector, dtype):
    flags = np.random.default_rng(16).random(GRID.shape) < 0.3
    active = ActiveVoxels.from_mask(GRID, flags)
    matrix = projector.to_scipy().tocoo()
    kept = flags.ravel()[matrix.col]
    ptr = np.concatenate(
        [[0], np.cumsum(np.bincount(matrix.row[kept], minlength=matrix.shape[0]))]
    )
    number = active.number[matrix.col[kept]].astype(np.int32)
    segments = Segments(ptr, number, matrix.data[kept])
    operator = Projector(segments, GRID, projector.view_ptr, active)
    assert operator.shape == (projector.shape[0], active.size)
    x, y = volume(17, dtype), images(projector, 18, dtype)
    x[~flags.ravel()] = 0
    close = {"rtol": 0, "atol": 1e-12 if dtype == np.float64 else 1e-5}
    for part, pixels in (
        (operator, slice(None)),
        (operator.subset([2, 1]), projector.pixels_of([2, 1])),
    ):
        assert part.active is active
        np.testing.assert_allclose(part @ active.compress(x), (projector @ x)[pixels], **close)
    np.testing.assert_allclose(operator.T @ y, active.compress(projector.T @ y), **close)


def test_vectors_that_are_not_contiguous_or_writable(projector):
    x, y = volume(12), images(projector, 13)
    strided = np.repeat(x, 2)[::2]
    frozen = y.copy()
    frozen.flags.writeable = False
    np.testing.assert_array_equal(projector @ strided, projector @ x)
    np.testing.assert_array_equal(projector.T @ frozen, projector.T @ y)


@pytest.mark.parametrize("view_ptr", [[0, 5], [1, 6], [0, 4, 2, 6], [0, 7]])
def test_a_view_ptr_that_does_not_fit_is_refused(projector, view_ptr):
    with pytest.raises(ValueError, match="view_ptr: expected ascending from 0 to 6 pixels"):
        Projector(projector.segments.rows(0, 6), GRID, view_ptr)


@pytest.mark.parametrize("shape", [(4, 4, 4), (20, 20, 20)], ids=["few", "many"])
@pytest.mark.parametrize("negative", [True, False])
def test_crossings_of_what_is_no_unknown_are_refused(shape, negative):
    grid = VoxelGrid(shape, 1.0)
    active = ActiveVoxels(grid, np.arange(7, grid.size))
    number = -1 if negative else active.size
    voxel = np.array([0, number, 1], np.int32)
    segments = Segments(np.array([0, 3]), voxel, np.ones(3, np.float32))
    found = f"found {min(number, 0)} to {max(number, 1)}, expected the numbers of {active.size} "
    with pytest.raises(ValueError, match=f"segments voxel: {found}"):
        Projector(segments, grid, active=active)
    assert Projector(replace(segments, voxel=voxel * 0), grid, active=active).shape == (
        1,
        active.size,
    )
