"""Grids and matrices with more than 2^31 entries, in memory that is never touched.

The system gives pages only to what is written to: numbers of 216 GB can be addressed, and are,
where single rays through 3000^3 voxels go.
"""

from __future__ import annotations

import mmap
import sys
from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import DTypeLike, NDArray

import rigs
from _stress.row import Row, Size, faults_of_refusing, relative_error
from tomo import Projector
from tomo.grid import VoxelGrid
from tomo.operators import check_memory, choose_form
from tomo.operators.on_the_fly import kernels
from tomo.operators.on_the_fly.ray_setup import WIDTH
from tomo.operators.on_the_fly.ray_sources import RayPixels
from tomo.operators.on_the_fly.running_sums import turned
from tomo.rays import Rays
from tomo.trace import TRACERS, Segments, trace
from tomo.trace.march import _move_down

SIDE = 3000
COLUMNS = 300  # of a ray, that hold anything
BEYOND = 2**31 + 77  # entries before the first that is looked at

_NO_RESERVE = 0x4000  # Linux's MAP_NORESERVE, which Python names from 3.13 on


def large_rows(size: Size) -> Iterator[Row]:
    """Yield what becomes of indices beyond 2^31."""
    grid = VoxelGrid((SIDE,) * 3, 0.25)
    rays = _rays(grid, 2 if size.quick else 6, size.seed)
    segments = trace(rays, grid, midpoints=True, dtype=np.float64)
    yield _voxel_numbers(grid, segments)
    if sys.platform == "linux":
        yield _running_sums(grid, rays, segments, size.seed)
        yield _entries(size.seed)
        yield _moved_entries()
    yield _refused()


def _rays(grid: VoxelGrid, n: int, seed: int) -> Rays:
    random = np.random.default_rng(seed)
    directions = np.array([[1, 0.9, 0.8], [-0.7, 1, 0.9], [0.8, -0.6, -1]] * n)[:n]
    target = random.uniform(0.8, 1, (n, 3)) * grid.upper
    return Rays.from_lines(target - 900 * directions, directions)


def _voxel_numbers(grid: VoxelGrid, segments: Segments) -> Row:
    index = np.floor(segments.midpoint / 0.25 + SIDE / 2).astype(np.int64)  # (crossings, 3)
    expected = (index[:, 0] * SIDE + index[:, 1]) * SIDE + index[:, 2]
    sure = segments.length > 1e-6  # shorter ones: on which side the middle lies is rounding
    wrong = int((segments.voxel != expected)[sure].sum())
    beyond = (segments.voxel > 2**31).mean()
    return Row(
        "Voxel numbers beyond 2^31", f"rays through {SIDE}^3 voxels", wrong, 0, "faults",
        note=f"{len(segments)} crossings, {beyond:.0%} of them beyond 2^31",
    )  # fmt: skip


def _running_sums(grid: VoxelGrid, rays: Rays, segments: Segments, seed: int) -> Row:
    """Project a volume of few columns, and back, through running sums of all."""
    random = np.random.default_rng(seed)
    worst = 0.0
    measured = random.random(len(rays)) + 0.5
    ray = np.repeat(np.arange(len(rays)), np.diff(segments.ptr))
    place = np.stack(np.unravel_index(segments.voxel, grid.shape), axis=1)  # (crossings, 3)
    for axes in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        shape = turned(grid.shape, axes)
        courses = np.zeros((len(rays), WIDTH))
        RayPixels(rays).writer(grid, axes)(0, len(rays), courses)
        along, b, c = place[:, axes[0]], *axes[1:]
        mine = (courses[:, 5] > courses[:, 4])[ray]  # leaves where it enters: no course
        if not mine.any():
            continue
        column = place[:, b] * shape[2] + place[:, c]
        chosen = random.permutation(np.unique(column[mine]))[:COLUMNS]
        values = random.random((len(chosen), SIDE))
        sums = _untouched(SIDE * SIDE * (SIDE + 1) + 1, np.float64)
        for one, value in zip(chosen, values, strict=True):
            sums[one * (SIDE + 1) + 1 : (one + 1) * (SIDE + 1)] = np.cumsum(value)
        images = np.zeros(len(rays))
        number, ptr = np.zeros(0, np.int64), rays.pixel_ptr
        kernels.forward(courses, ptr, shape, number, np.zeros(0, np.float32), sums, images)
        del sums
        order = np.argsort(chosen)
        found = np.minimum(np.searchsorted(chosen, column, sorter=order), len(chosen) - 1)
        some = mine & (chosen[order[found]] == column)
        owner, length = order[found[some]], segments.length[some]
        expected = np.bincount(ray[some], length * values[owner, along[some]], len(rays))
        worst = max(worst, relative_error(images, expected))

        differences = _untouched(SIDE * SIDE * (SIDE + 1) + 1, np.uint64)
        for low, high in ((0, SIDE // 2), (SIDE // 2, SIDE)):
            kernels.adjoint(
                courses, ptr, shape, number, low, high, 2.0**40, measured,
                differences[low * SIDE * (SIDE + 1) :],
            )  # fmt: skip
        back, wanted = np.zeros_like(values), np.zeros_like(values)
        np.add.at(wanted, (owner, along[some]), length * measured[ray[some]])
        for row, one in enumerate(chosen):
            own = differences[one * (SIDE + 1) + 1 : (one + 1) * (SIDE + 1)].view(np.int64)
            back[row] = np.cumsum(own[::-1])[::-1] / 2.0**40
        worst = max(worst, relative_error(back, wanted))
    return Row(
        "Running sums beyond 2^31, projected and back", f"{SIDE}^3 voxels, 216 GB addressed",
        worst, 1e-9, "of the result",
    )  # fmt: skip


def _entries(seed: int) -> Row:
    """Multiply with the last rows of a matrix whose first row has more than 2^31 entries."""
    grid = VoxelGrid((14, 15, 16), 1.0)  # so few voxels that no other order of them is kept
    random = np.random.default_rng(seed)
    directions = random.standard_normal((500, 3))
    rays = Rays.from_lines(random.uniform(-5, 5, (500, 3)) - 50 * directions, directions)
    small = trace(rays, grid)
    last = slice(BEYOND, BEYOND + len(small))
    voxel = _untouched(last.stop, np.int32)
    length = _untouched(last.stop, np.float32)
    voxel[last], length[last] = small.voxel, small.length
    large = Segments(np.append(0, BEYOND + small.ptr), voxel, length)
    whole = Projector(large, grid, [0, 1, 200, 501]).rows(1, 501)
    kept = Projector(small, grid)
    x, y = random.random(grid.size), random.random(500)
    some = np.arange(3, 480, 7)
    worst = max(
        relative_error(whole @ x, kept @ x),
        relative_error(whole.T @ y, kept.T @ y),
        relative_error(whole.take(some) @ x, kept.take(some) @ x),
        relative_error(large.take(some + 1).length, small.take(some).length),
    )
    return Row(
        "Entries of a matrix beyond 2^31", f"{last.stop:,} crossings", worst, 0.0, "of the result"
    )


def _moved_entries() -> Row:
    array = _untouched(3 * (BEYOND + 14_000), np.uint32)
    begin, ptr = np.array([0, BEYOND + 5000]), np.array([0, BEYOND, BEYOND + 9000])
    values = np.arange(27_000, dtype=np.uint32)
    array[3 * begin[1] : 3 * begin[1] + 27_000] = values
    # the first chunk stands where it belongs: nothing of it is touched
    _move_down(begin, ptr, 3, array, array)
    wrong = int((array[3 * BEYOND : 3 * BEYOND + 27_000] != values).sum())
    return Row("Entries moved beyond 2^31", f"{3 * BEYOND:,} words", wrong, 0, "faults")


def _refused() -> Row:
    """Grids that no memory holds and no float64 measures: refused in one line."""
    rig = tuple(rigs.ring(33, distance=500, image_size=(640, 480), footprint=0.5))
    calls = []
    for side in (3000, 10**5, 10**9):
        grid = VoxelGrid((side,) * 3, 100 / side)
        for form in ("auto", "stored", "on-the-fly"):
            choose = partial(choose_form, rig, grid, wanted=form, available=64 * 10**9)
            calls.append((f"{side}^3 {form}", choose))
        calls.append((f"{side}^3", partial(check_memory, rig, grid, available=10**9)))
    huge = VoxelGrid((2**22,) * 3, 1.0)
    ray = Rays.from_lines(huge.lower - 1, [1, 1, 1])
    calls += [
        ("voxels beyond int64", partial(huge.voxel_of, huge.center)),
        *((f"{tracer} beyond 2^53", partial(trace, ray, huge, tracer)) for tracer in TRACERS),
        ("voxels of 1e308", partial(VoxelGrid, (4, 4, 4), 1e308)),
        ("voxels of 5e-324", partial(VoxelGrid, (4, 4, 4), 5e-324)),
        ("1e17 voxels off", partial(VoxelGrid, (4, 4, 4), 1.0, (1e17, 0, 0))),
        ("a direction of nothing", partial(Rays.from_lines, [0, 0, 0], [0, 0, 0])),
        ("an infinite direction", partial(Rays.from_lines, [0, 0, 0], [1, np.inf, 0])),
    ]
    faults = faults_of_refusing(calls)
    return Row.of_faults(
        "Grids beyond any memory, and rays that are none, are refused",
        "3000^3 to 1e27 voxels in every form, voxels of 5e-324 and 1e308",
        faults,
    )


def _untouched(count: int, dtype: DTypeLike) -> NDArray:
    """Return zeros (count,) that take no memory until they are written to."""
    kind = np.dtype(dtype)
    flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | _NO_RESERVE
    pages = mmap.mmap(-1, int(count) * kind.itemsize, flags=flags)
    pages.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(pages, kind)
