"""The operator: chunks of rays are projected on all threads, one driving axis after another."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.grouping import index_type
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators.on_the_fly import kernels
from tomo.operators.on_the_fly.chunks import (
    RAYS_AT_ONCE,
    Chunk,
    ColumnsMet,
    CrossingCounts,
    Visit,
    chunks_of,
    columns_met,
    count_crossings,
    project_chunks,
    project_groups,
)
from tomo.operators.on_the_fly.ray_sources import (
    Numbers,
    PixelSource,
    RayPixels,
    pixels_between,
    pixels_by_source,
)
from tomo.operators.on_the_fly.running_sums import (
    ORDERS,
    Axes,
    add_differences,
    adjoint_with_nonfinite,
    in_order,
    running_sums,
)
from tomo.operators.operator import ProjectionOperator, as_float
from tomo.rays import Rays

DIFFERENCES = 56 * 2**20
"""Bytes that the adjoint may take for its integers, or three quarters of a larger volume: less
goes through the rays more often, more than one volume is memory that the user did not expect."""

FEW_COLUMNS = 16
"""Columns along an axis below which it is never split between threads: they would be uneven."""


class OnTheFlyProjector(ProjectionOperator):
    """The same matrix as `tomo.operators.Projector`, never stored.

    Sources of rays (`camera_sources.pixel_source`), each a view where there is no ``view_ptr``,
    make them when they are needed: they take 8 bytes a distorted ray, 64 bytes a ray of a table,
    and little else. `tomo.operators.on_the_fly` has the formulas. With float32 the error is about
    1e-7 of the largest running sum, not of the ray's own value: rays through nearly empty space
    next to bright voxels are less exact relative to themselves. A voxel that is not finite makes
    all rays that meet its columns non-finite; a pixel that is not finite, all voxels that it sees.

    A product takes the memory of one more volume, and 1 MB a thread for its chunk of rays. Voxels
    that are not active are zeros.
    """

    def __init__(
        self,
        rays: Rays | Sequence[PixelSource],
        grid: VoxelGrid,
        view_ptr: ArrayLike | None = None,
        active: ActiveVoxels | None = None,
    ) -> None:
        self._sources = (RayPixels(rays),) if isinstance(rays, Rays) else tuple(rays)
        self._met: dict[Axes, ColumnsMet] = {}
        self._ptr = np.cumsum([0] + [source.n_pixels for source in self._sources])
        view_ptr = self._ptr if view_ptr is None else view_ptr
        super().__init__(int(self._ptr[-1]), grid, view_ptr, np.float32, active)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<OnTheFlyProjector: {self.n_views} views, {self.shape[0]} pixels, {self.grid}>"

    @property
    def n_segments(self) -> int:
        """Number of segments of rays in voxels; passing an edge counts as two face crossings."""
        return sum(one.segments for one in self._counts)

    def through(self, active: ActiveVoxels) -> OnTheFlyProjector:
        """Return the projector of the same rays through the voxels of another grid."""
        return OnTheFlyProjector(self._sources, active.grid, self.view_ptr, active)

    def rows(self, start: int, stop: int) -> OnTheFlyProjector:
        """Return the projector of pixels ``start:stop`` as one view; rays are shared."""
        return self._some(pixels_between(self._ptr, start, stop), [0, stop - start])

    def _taken(
        self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]
    ) -> OnTheFlyProjector:
        return self._some(pixels_by_source(self._ptr, pixels), view_ptr)

    def _some(
        self, wanted: Sequence[tuple[int, Numbers]], view_ptr: ArrayLike
    ) -> OnTheFlyProjector:
        """Return the projector of some pixels of some sources, one after another."""
        sources = [self._sources[number].take(pixels) for number, pixels in wanted]
        projector = OnTheFlyProjector(sources, self.grid, view_ptr, self.active)
        if "_orders" in self.__dict__:  # rays of some pixels go along no other axes
            projector.__dict__["_axes"] = [self._axes[number] for number, _ in wanted]
            projector.__dict__["_orders"] = self._orders
        return projector

    def some_rays(self) -> Iterator[tuple[int, int, Rays]]:
        """Iterate over the rays of some pixels at a time: ``start, stop, rays``."""
        for source, first in zip(self._sources, self._ptr[:-1], strict=True):
            for start, stop, _ in source.portions(RAYS_AT_ONCE):
                yield int(first) + start, int(first) + stop, source.rays(start, stop)

    @cached_property
    def _counts(self) -> list[CrossingCounts]:
        """What the rays of each source cross."""
        nothing = np.zeros(0, np.bool_)
        return [
            replace(count_crossings(source, self.grid), meets=nothing) for source in self._sources
        ]

    @cached_property
    def _axes(self) -> list[tuple[bool, bool, bool]]:
        """For each source, whether any of its rays has x, y or z for driving axis."""
        return [one.axes for one in self._counts]

    @cached_property
    def _orders(self) -> list[Axes]:
        """For each driving axis the order of all axes, the one with most face crossings last.

        Neighbouring columns along the last axis are neighbours in memory. An axis of few voxels
        is last in any case: the adjoint splits the columns along the other between threads.
        """
        faces = sum((one.faces for one in self._counts), np.zeros((3, 3), np.int64))

        def last(along: int, axis: int) -> tuple[bool, int]:
            return self.grid.shape[axis] < FEW_COLUMNS, int(faces[along][axis])

        found = []
        for a, *others in ORDERS:
            b, c = sorted(others, key=partial(last, a))
            found.append((a, b, c))
        return found

    def _matvec(self, x: NDArray) -> NDArray:
        volume = self.active.expand(as_float(x.ravel()))
        images = np.zeros(self.shape[0], volume.dtype)
        for axes in self._orders:
            self._project_along(axes, volume, images)
        return images

    def _project_along(self, axes: Axes, volume: NDArray, images: NDArray) -> None:
        """Add to ``images`` the sums along the rays with one driving axis."""
        chunks = self._chunks(axes)
        if not chunks:
            return
        shape, sums = in_order(self.grid.shape, axes), running_sums(volume, self.grid.shape, axes)

        def visit(chunk: Chunk, parameters: NDArray, pixel_ptr: NDArray) -> None:
            some = np.zeros(len(pixel_ptr) - 1)
            kernels.forward(parameters, pixel_ptr, shape, self._index_of, *sums, some)
            chunk.add_to(images, some)

        project_chunks(chunks, self.grid, axes, visit)

    def _rmatvec(self, y: NDArray) -> NDArray:
        y = as_float(y.ravel())
        most = self._most(y)
        if not math.isfinite(most):  # cheaper than to look at every pixel each time
            finite = np.isfinite(y)
            if not finite.all():
                return adjoint_with_nonfinite(self._rmatvec, y, finite)
            return np.full(self.shape[1], np.nan, y.dtype)
        volume = np.zeros(self.grid.size, y.dtype)
        if most > 0:
            per_unit = math.ldexp(1.0, min(61 - math.frexp(most)[1], 1023))
            for axes in self._orders:
                self._add_along(axes, y, per_unit, volume)
        return self.active.compress(volume)

    def _most(self, y: NDArray) -> float:
        """Return a bound of the sum that all pixels ``y`` add to a voxel."""
        step = math.sqrt(3) * max(self.grid.spacing)  # one voxel along the driving axis, or less
        spans = zip(self._sources, self._ptr[:-1], self._ptr[1:], strict=True)
        total = sum(
            source.largest_weight * float(np.abs(y[start:stop]).sum(dtype=np.float64))
            for source, start, stop in spans
        )
        return step * total

    def _add_along(self, axes: Axes, y: NDArray, per_unit: float, volume: NDArray) -> None:
        """Add the back-projection of the rays with one driving axis, some columns at a time.

        Each thread has a range of columns of its own: no two threads add to the same number.
        """
        chunks = self._chunks(axes)
        if not chunks:
            return
        n_a, n_b, n_c = in_order(self.grid.shape, axes)
        plane = n_c * (n_a + 1)  # integers for each column along b
        room = max(volume.nbytes * 3 // 4, DIFFERENCES)
        passes = -(-n_b // max(room // (8 * plane), 1))
        steps = -(-n_b // passes)
        differences = np.zeros(steps * plane, np.uint64)
        for low in range(0, n_b, steps):
            columns = range(low, min(low + steps, n_b))
            if low > 0:  # new memory is zero, and touched first by the threads that add to it
                differences[:] = 0
            self._add_differences(chunks, axes, columns, y, per_unit, differences)
            add_differences(differences, self.grid.shape, axes, columns, 1 / per_unit, volume)

    def _add_differences(
        self,
        chunks: Sequence[Chunk],
        axes: Axes,
        columns: range,
        y: NDArray,
        per_unit: float,
        differences: NDArray[np.uint64],
    ) -> None:
        """Add the chunks' pixels to ``differences``, those of some columns along b."""
        shape = in_order(self.grid.shape, axes)
        plane = shape[2] * (shape[0] + 1)
        threads = numba.get_num_threads()
        if threads == 1 and len(columns) == shape[1]:
            groups = [((0, shape[1]), list(chunks))]
        else:
            if axes not in self._met:
                self._met[axes] = columns_met(chunks, self.grid, axes)
            groups = self._met[axes].groups(chunks, columns, threads)

        def visitor(some: tuple[int, int]) -> Visit:
            low, high = some
            mine = differences[(low - columns[0]) * plane : (high - columns[0]) * plane]

            def visit(chunk: Chunk, parameters: NDArray, pixel_ptr: NDArray) -> None:
                index_of, images = self._index_of, chunk.of(y)
                kernels.adjoint(
                    parameters, pixel_ptr, shape, index_of, low, high, per_unit, images, mine
                )

            return visit

        project_groups(groups, self.grid, axes, visitor)

    def _chunks(self, axes: Axes) -> list[Chunk]:
        """Return the pixels with rays of driving axis ``axes[0]``, in chunks."""
        return list(chunks_of(self._sources, [along[axes[0]] for along in self._axes]))

    @property
    def _index_of(self) -> NDArray[np.integer]:
        """An empty array of the type that holds the indices of running sums."""
        return np.zeros(0, index_type(math.prod(n + 1 for n in self.grid.shape)))
