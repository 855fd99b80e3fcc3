"""Grids and matrices with more than 2^31 entries, in memory that is never touched.

The system gives pages only to what is written to: numbers of 216 GB can be addressed, and are,
where single rays through 3000^3 voxels go.
"""

import mmap
import sys
from functools import partial

import numpy as np
import pytest

import rigs
from tomo import Projector, VoxelGrid
from tomo.operators import choose_form
from tomo.operators.on_the_fly import kernels
from tomo.operators.on_the_fly.ray_setup import WIDTH
from tomo.operators.on_the_fly.ray_sources import RayPixels
from tomo.operators.on_the_fly.running_sums import in_order
from tomo.rays import Rays
from tomo.trace import TRACERS, Segments, trace
from tomo.trace.march import _move_down

SIDE = 3000
COLUMNS = 300  # of a ray, that hold anything
BEYOND = 2**31 + 77  # entries before the first that is looked at
NO_RESERVE = 0x4000  # Linux's MAP_NORESERVE, which Python names from 3.13 on

linux = pytest.mark.skipif(sys.platform != "linux", reason="memory that is never touched")


def untouched(count, dtype):
    """Return zeros (count,) that take no memory until they are written to."""
    kind = np.dtype(dtype)
    flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | NO_RESERVE
    pages = mmap.mmap(-1, int(count) * kind.itemsize, flags=flags)
    pages.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(pages, kind)


@pytest.fixture(scope="module")
def through():
    """Return a grid of 3000^3 voxels, two rays through it, and what they cross."""
    grid = VoxelGrid((SIDE,) * 3, 0.25)
    directions = np.array([[1, 0.9, 0.8], [-0.7, 1, 0.9]])
    target = np.random.default_rng(0).uniform(0.8, 1, (2, 3)) * grid.upper
    rays = Rays.from_lines(target - 900 * directions, directions)
    return grid, rays, trace(rays, grid, midpoints=True, dtype=np.float64)


@linux
@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_running_sums_are_projected_and_back(through, axes):
    """Project a volume of few columns, and back, through running sums of all."""
    grid, rays, segments = through
    random = np.random.default_rng(0)
    measured = random.random(len(rays)) + 0.5
    ray = np.repeat(np.arange(len(rays)), np.diff(segments.ptr))
    place = np.stack(np.unravel_index(segments.voxel, grid.shape), axis=1)  # (crossings, 3)
    shape = in_order(grid.shape, axes)
    parameters = np.zeros((len(rays), WIDTH))
    RayPixels(rays).writer(grid, axes)(0, len(rays), parameters)
    along, b, c = place[:, axes[0]], *axes[1:]
    mine = (parameters[:, 5] > parameters[:, 4])[
        ray
    ]  # leaves where it enters: another axis drives it
    if not mine.any():
        return
    column = place[:, b] * shape[2] + place[:, c]
    chosen = random.permutation(np.unique(column[mine]))[:COLUMNS]
    values = random.random((len(chosen), SIDE))
    sums = untouched(SIDE * SIDE * (SIDE + 1) + 1, np.float64)
    for one, value in zip(chosen, values, strict=True):
        sums[one * (SIDE + 1) + 1 : (one + 1) * (SIDE + 1)] = np.cumsum(value)
    images, number, ptr = np.zeros(len(rays)), np.zeros(0, np.int64), rays.pixel_ptr
    kernels.forward(parameters, ptr, shape, number, np.zeros(0, np.float32), sums, images)
    del sums
    order = np.argsort(chosen)
    found = np.minimum(np.searchsorted(chosen, column, sorter=order), len(chosen) - 1)
    some = mine & (chosen[order[found]] == column)
    owner, length = order[found[some]], segments.length[some]
    expected = np.bincount(ray[some], length * values[owner, along[some]], len(rays))
    np.testing.assert_allclose(images, expected, rtol=1e-9)

    differences = untouched(SIDE * SIDE * (SIDE + 1) + 1, np.uint64)
    for low, high in ((0, SIDE // 2), (SIDE // 2, SIDE)):
        kernels.adjoint(
            parameters, ptr, shape, number, low, high, 2.0**40, measured,
            differences[low * SIDE * (SIDE + 1) :],
        )  # fmt: skip
    back, wanted = np.zeros_like(values), np.zeros_like(values)
    np.add.at(wanted, (owner, along[some]), length * measured[ray[some]])
    for row, one in enumerate(chosen):
        own = differences[one * (SIDE + 1) + 1 : (one + 1) * (SIDE + 1)].view(np.int64)
        back[row] = np.cumsum(own[::-1])[::-1] / 2.0**40
    assert np.linalg.norm(back - wanted) < 1e-9 * np.linalg.norm(wanted)


@linux
def test_the_last_rows_of_a_matrix_whose_first_row_is_longer_than_that():
    grid = VoxelGrid((14, 15, 16), 1.0)  # so few voxels that no other order of them is kept
    random = np.random.default_rng(0)
    directions = random.standard_normal((500, 3))
    rays = Rays.from_lines(random.uniform(-5, 5, (500, 3)) - 50 * directions, directions)
    small = trace(rays, grid)
    last = slice(BEYOND, BEYOND + len(small))
    voxel, length = untouched(last.stop, np.int32), untouched(last.stop, np.float32)
    voxel[last], length[last] = small.voxel, small.length
    large = Segments(np.append(0, BEYOND + small.ptr), voxel, length)
    whole, kept = Projector(large, grid, [0, 1, 200, 501]).rows(1, 501), Projector(small, grid)
    x, y = random.random(grid.size), random.random(500)
    some = np.arange(3, 480, 7)
    np.testing.assert_array_equal(whole @ x, kept @ x)
    np.testing.assert_array_equal(whole.T @ y, kept.T @ y)
    np.testing.assert_array_equal(whole.take(some) @ x, kept.take(some) @ x)
    np.testing.assert_array_equal(large.take(some + 1).length, small.take(some).length)


@linux
def test_entries_are_moved_down_from_there():
    array = untouched(3 * (BEYOND + 14_000), np.uint32)
    begin, ptr = np.array([0, BEYOND + 5000]), np.array([0, BEYOND, BEYOND + 9000])
    values = np.arange(27_000, dtype=np.uint32)
    array[3 * begin[1] : 3 * begin[1] + 27_000] = values
    # the first chunk stands where it belongs: nothing of it is touched
    _move_down(begin, ptr, 3, array, array)
    np.testing.assert_array_equal(array[3 * BEYOND : 3 * BEYOND + 27_000], values)


def refused():
    """Return calls for grids that no memory holds and no float64 measures, by name."""
    rig = tuple(rigs.ring(33, distance=500, image_size=(640, 480), footprint=0.5))
    calls = {}
    for side in (3000, 10**5, 10**9):
        grid = VoxelGrid((side,) * 3, 100 / side)
        for form in ("auto", "stored", "on-the-fly"):
            calls[f"{side}^3 {form}"] = partial(
                choose_form, rig, grid, wanted=form, available=64 * 10**9
            )
    huge = VoxelGrid((2**22,) * 3, 1.0)
    ray = Rays.from_lines(huge.lower - 1, [1, 1, 1])
    calls |= {f"{tracer} beyond 2^53": partial(trace, ray, huge, tracer) for tracer in TRACERS}
    return calls | {
        "voxels beyond int64": partial(huge.voxel_of, huge.center),
        "voxels of 1e308": partial(VoxelGrid, (4, 4, 4), 1e308),
        "voxels of 5e-324": partial(VoxelGrid, (4, 4, 4), 5e-324),
        "1e17 voxels off": partial(VoxelGrid, (4, 4, 4), 1.0, (1e17, 0, 0)),
    }


@pytest.mark.parametrize("name", refused())
def test_grids_beyond_any_memory_and_rays_that_are_none_are_refused_in_one_line(name):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        refused()[name]()
    assert len(str(error.value).splitlines()) == 1
