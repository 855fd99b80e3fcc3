import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tomo.grid import VoxelGrid

counts = st.integers(1, 9)
edges = st.floats(1e-3, 1e3)
coordinates = st.floats(-1e4, 1e4)
grids = st.builds(
    VoxelGrid,
    st.tuples(counts, counts, counts),
    st.tuples(edges, edges, edges),
    st.tuples(coordinates, coordinates, coordinates),
)
PLAIN = VoxelGrid((2, 3, 4), 0.5, (10, 20, 30))  # every face is exact in binary


@given(grids)
def test_voxel_of_the_centers_is_the_identity(grid):
    found = grid.voxel_of(grid.centers())
    np.testing.assert_array_equal(found, np.arange(grid.size).reshape(grid.shape))


@given(grids, st.integers(0, 2**32 - 1))
def test_a_point_in_a_voxel_is_found_there(grid, seed):
    offset = np.random.default_rng(seed).uniform(-0.49, 0.49, (*grid.shape, 3)) * grid.spacing
    found = grid.voxel_of(grid.centers() + offset)
    np.testing.assert_array_equal(found, np.arange(grid.size).reshape(grid.shape))


@given(grids)
def test_both_outer_corners_belong_to_the_grid(grid):
    assert grid.voxel_of(grid.lower) == 0
    assert grid.voxel_of(grid.upper) == grid.size - 1
    assert (grid.to_voxel_units(grid.upper) <= grid.shape).all()
    np.testing.assert_array_equal(grid.to_voxel_units(grid.lower), 0)


@given(grids, st.integers(0, 2), st.sampled_from([-1, 1]))
def test_beyond_a_face_there_is_no_voxel(grid, axis, side):
    point = np.array(grid.center)
    point[axis] += side * (grid.extent[axis] / 2 + 0.01 * grid.spacing[axis])
    assert grid.voxel_of(point) == -1


def test_a_point_on_a_face_belongs_to_the_voxel_above():
    z = PLAIN.lower[2] + 0.5 * np.arange(5)
    points = np.stack([np.full(5, 9.6), np.full(5, 19.3), z], axis=1)
    np.testing.assert_array_equal(PLAIN.voxel_of(points), [0, 1, 2, 3, 3])
    below = np.nextafter(points, -np.inf)
    np.testing.assert_array_equal(PLAIN.voxel_of(below), [-1, 0, 1, 2, 3])
    assert PLAIN.voxel_of([9.6, 19.3, 31.0001]) == -1


def test_points_without_a_place_are_outside():
    points = [[np.nan, 20, 30], [np.inf, 20, 30], [10, -np.inf, 30], [1e300, 20, 30]]
    np.testing.assert_array_equal(PLAIN.voxel_of(points), -1)


def test_numbers_run_fastest_along_z():
    lowest = PLAIN.origin
    assert PLAIN.voxel_of(lowest + np.array([0, 0, 0.5])) == 1
    assert PLAIN.voxel_of(lowest + np.array([0, 0.5, 0])) == 4
    assert PLAIN.voxel_of(lowest + np.array([0.5, 0, 0])) == 12


@given(grids)
def test_the_box_is_where_it_is_said_to_be(grid):
    scale = np.abs(grid.center).max() + grid.extent.max()
    near = {"rtol": 0, "atol": 1e-12 * scale}
    np.testing.assert_allclose(grid.lower + grid.upper, 2 * np.array(grid.center), **near)
    np.testing.assert_allclose(grid.upper - grid.lower, grid.extent, **near)
    np.testing.assert_allclose(grid.centers()[0, 0, 0], grid.origin, **near)
    np.testing.assert_allclose(grid.centers()[-1, -1, -1] - grid.upper, grid.lower - grid.origin,
                               **near)  # fmt: skip
    np.testing.assert_allclose(grid.to_voxel_units(grid.center), np.array(grid.shape) / 2,
                               atol=1e-12 * scale / min(grid.spacing))  # fmt: skip


@given(grids)
def test_bounds_and_origin_give_the_grid_back(grid):
    scale = np.abs(grid.center).max() + grid.extent.max()
    for other in (
        VoxelGrid.from_bounds(grid.shape, grid.lower, grid.upper),
        VoxelGrid.from_origin(grid.shape, grid.spacing, grid.origin),
    ):
        assert other.shape == grid.shape
        np.testing.assert_allclose(other.spacing, grid.spacing, rtol=0, atol=1e-12 * scale)
        np.testing.assert_allclose(other.center, grid.center, rtol=0, atol=1e-12 * scale)


@given(grids)
def test_its_repr_makes_it(grid):
    again = eval(repr(grid))
    assert again == grid
    assert hash(again) == hash(grid)


def test_numpy_numbers_make_the_same_value():
    from_arrays = VoxelGrid(np.array([2, 3, 4]), np.float32(0.5), np.array([10, 20, 30]))
    assert from_arrays == PLAIN
    assert repr(from_arrays) == repr(PLAIN)
    assert from_arrays != VoxelGrid((2, 3, 4), 0.5)


@given(grids, st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_averaging_a_refined_volume_keeps_the_integral(grid, factor, seed):
    fine = grid.refined(factor)
    np.testing.assert_allclose(fine.extent, grid.extent)
    assert fine.center == grid.center
    volume = np.random.default_rng(seed).normal(1, 1, fine.shape)
    coarse = grid.average(volume, factor)
    assert coarse.shape == grid.shape
    np.testing.assert_allclose(
        coarse.sum() * np.prod(grid.spacing), volume.sum() * np.prod(fine.spacing), rtol=1e-9,
        atol=1e-9 * np.prod(grid.extent),
    )  # fmt: skip


@given(grids, st.integers(1, 3))
def test_averaging_puts_every_fine_voxel_where_it_lies(grid, factor):
    fine = grid.refined(factor)
    inside = grid.voxel_of(fine.centers())
    np.testing.assert_allclose(
        grid.average(inside.astype(float), factor), np.arange(grid.size).reshape(grid.shape)
    )


def test_averaging_keeps_single_precision_and_sums_in_double():
    grid = VoxelGrid((1, 1, 1), 1.0)
    fine = np.full((256, 256, 256), 0.1, np.float32)
    mean = grid.average(fine, 256)
    assert mean.dtype == np.float32
    assert mean[0, 0, 0] == np.float32(0.1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: VoxelGrid((2, 3, 0), 1.0), "grid shape: found"),
        (lambda: VoxelGrid((2, 3, 2.5), 1.0), "grid shape: found"),
        (lambda: VoxelGrid((2, 3, 4), 0.0), "grid spacing: found"),
        (lambda: VoxelGrid((2, 3, 4), (1, np.nan, 1)), "grid spacing: found"),
        (lambda: VoxelGrid((2, 3, 4), 1e308), "grid spacing: found 1e"),
        (
            lambda: VoxelGrid((2, 3, 4), 1, (0, 1e17, 0)),
            "center: .*coordinates there are 16 apart",
        ),
        (lambda: VoxelGrid((2**22,) * 3, 1.0).voxel_of((0, 0, 0)), "more voxels than int64"),
        (lambda: VoxelGrid((2, 3, 4), 1, (0, 0)), "grid center: found"),
        (lambda: VoxelGrid.from_bounds((2, 3, 4), (0, 0, 0), (1, 0, 1)), "grid bounds: found"),
        (lambda: VoxelGrid.from_bounds((2, 0, 4), (0, 0, 0), (1, 1, 1)), "grid shape: found"),
        (lambda: VoxelGrid.from_origin((2, 4), 1, (0, 0, 0)), "grid shape: found"),
        (lambda: PLAIN.refined(0), "grid refinement: found 0"),
        (lambda: PLAIN.refined(1.5), "grid refinement: found 1.5"),
        (lambda: PLAIN.average(np.zeros((2, 3, 4)), 2), "volume to average: found"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("arguments", [("abc", 1.0), (6, 1.0), ((2, 2, 2), "a")])
def test_what_are_no_numbers_is_quoted_as_found(arguments):
    with pytest.raises(ValueError, match=r"^grid (shape|spacing): found .*, expected"):
        VoxelGrid(*arguments)
    with pytest.raises(ValueError, match=r"^grid center: found x, expected three"):
        VoxelGrid((2, 2, 2), 1.0, "x")
