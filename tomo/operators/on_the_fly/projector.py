"""The projector without a stored matrix: rays and chord lengths are computed at every product."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs import CameraLike
from tomo._compute.index_types import numbering
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators.on_the_fly import kernels
from tomo.operators.on_the_fly.chunks import Follow, Share, follow_all, follow_groups, shares_of
from tomo.operators.on_the_fly.counting_pass import ColumnsMet, Survey, columns_met, survey
from tomo.operators.on_the_fly.nonfinite import spoiled
from tomo.operators.on_the_fly.ray_sources import Numbers, PixelSource, RayPixels, pixel_source
from tomo.operators.on_the_fly.running_sums import (
    ORDERS,
    Axes,
    add_differences,
    running_sums,
    turned,
)
from tomo.operators.on_the_fly.source_pixels import pixels_between, pixels_by_source
from tomo.operators.operator import ProjectionOperator, as_float
from tomo.rays import Rays

DIFFERENCES = 56 * 2**20
"""Bytes that an adjoint may take even for a smaller volume, and of a larger one three quarters:
of 256^3 voxels that is a third of all columns at a time, and 3 % slower than half of them."""

FEW_COLUMNS = 16
"""Of fewer, threads could not have about as many each."""


class OnTheFlyProjector(ProjectionOperator):
    """The same matrix as `tomo.operators.Projector`, never stored.

    Parameters
    ----------
    rays : Rays
    grid : VoxelGrid
    view_ptr : (views + 1,) int, optional
        Where each view's pixels begin; one view when None.
    active : ActiveVoxels, optional
        The unknowns; all voxels when None.

    Notes
    -----
    Chord lengths are exact, in double precision relative to the grid. A product with float64 is
    good to about 1e-13 of the largest result. One with float32 reads running sums of the volume
    along one axis (`tomo.operators.on_the_fly.kernels`) rounded to single precision, so that its
    error is about 1e-7 of the largest such sum, not of the ray's own value: rays through nearly
    empty space beside bright voxels are less good relative to themselves. A voxel that is not
    finite spoils all rays that meet its columns.

    The adjoint has the same shares, rounded to whole multiples of 2^-61 of what all pixels
    together could add to a voxel at most; all sums of them are exact, so that a voxel that no ray
    meets gets zero. Results do not depend on the number of threads.

    A product takes the memory of one more volume, and 1 MB a thread for the rays that it is at.
    Rays from cameras are made when needed: see `from_cameras`. Work grows with the rays' changes
    of column, not with the voxels that they meet: voxels that are not active are zeros.
    """

    def __init__(
        self,
        rays: Rays,
        grid: VoxelGrid,
        view_ptr: ArrayLike | None = None,
        active: ActiveVoxels | None = None,
    ) -> None:
        self._set((RayPixels(rays),), grid, view_ptr, active)

    @classmethod
    def from_cameras(
        cls,
        cameras: Sequence[CameraLike],
        pixels: Sequence[NDArray[np.integer] | None] | None,
        grid: VoxelGrid,
        supersample: int = 1,
        active: ActiveVoxels | None = None,
    ) -> OnTheFlyProjector:
        """Return the projector of cameras, one a view; 8 bytes a distorted ray, little else.

        A table of rays takes 64 bytes a ray.

        Parameters
        ----------
        cameras : sequence of CameraLike
        pixels : sequence of (P_v,) int, optional
            For each camera its flat pixel numbers ``row * width + column``; all where None.
        grid : VoxelGrid
        supersample : int
            Rays along each side of a pixel, as in `Rays.from_camera`.
        active : ActiveVoxels, optional
        """
        chosen = [None] * len(cameras) if pixels is None else pixels
        sources = tuple(
            pixel_source(camera, some, supersample)
            for camera, some in zip(cameras, chosen, strict=True)
        )
        return cls.from_sources(sources, grid, active)

    @classmethod
    def from_sources(
        cls, sources: Sequence[PixelSource], grid: VoxelGrid, active: ActiveVoxels | None = None
    ) -> OnTheFlyProjector:
        """Return the projector of pixels with rays, one source a view, see `ray_sources`."""
        view_ptr = np.cumsum([0] + [source.n_pixels for source in sources])
        return cls._of(tuple(sources), grid, view_ptr, active)

    @classmethod
    def _of(
        cls,
        sources: tuple[PixelSource, ...],
        grid: VoxelGrid,
        view_ptr: ArrayLike | None,
        active: ActiveVoxels | None,
    ) -> OnTheFlyProjector:
        projector = cls.__new__(cls)
        projector._set(sources, grid, view_ptr, active)
        return projector

    def _set(self, sources, grid, view_ptr, active) -> None:
        self._sources, self._met = sources, {}
        self._ptr = np.cumsum([0] + [source.n_pixels for source in sources])
        super().__init__(int(self._ptr[-1]), grid, view_ptr, np.float32, active)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<OnTheFlyProjector: {self.n_views} views, {self.shape[0]} pixels, {self.grid}>"

    @property
    def n_segments(self) -> int:
        """How many crossings of rays with voxels there are, edges and corners aside."""
        return sum(one.crossings for one in self._surveys)

    def rows(self, start: int, stop: int) -> OnTheFlyProjector:
        """Return the projector of pixels ``start:stop`` as one view; rays are shared."""
        return self._some(pixels_between(self._ptr, start, stop), None)

    def _taken(
        self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]
    ) -> OnTheFlyProjector:
        return self._some(pixels_by_source(self._ptr, pixels), view_ptr)

    def _some(
        self, wanted: Sequence[tuple[int, Numbers]], view_ptr: NDArray[np.int64] | None
    ) -> OnTheFlyProjector:
        """Return the projector of some pixels of some sources, one after another."""
        sources = tuple(self._sources[number].take(pixels) for number, pixels in wanted)
        projector = self._of(sources, self.grid, view_ptr, self.active)
        if "_orders" in self.__dict__:  # rays of some pixels go along no other axes
            projector.__dict__["_axes"] = [self._axes[number] for number, _ in wanted]
            projector.__dict__["_orders"] = self._orders
        return projector

    @cached_property
    def _surveys(self) -> list[Survey]:
        """What the rays of each source do, all pixels taken together."""
        nothing = np.zeros(0, np.bool_)
        return [replace(survey(source, self.grid), meets=nothing) for source in self._sources]

    @cached_property
    def _axes(self) -> list[tuple[bool, bool, bool]]:
        """For each source, along which axes rays of it may go."""
        return [one.axes for one in self._surveys]

    @cached_property
    def _orders(self) -> list[Axes]:
        """For each long axis the order of all: last the one along which columns change most.

        Columns that follow each other along it lie side by side. An axis of few voxels is the
        last in any case: threads of an adjoint share out the columns along the other.
        """
        changes = sum((one.changes for one in self._surveys), np.zeros((3, 3), np.int64))

        def last(along: int, axis: int) -> tuple[bool, int]:
            return self.grid.shape[axis] < FEW_COLUMNS, int(changes[along][axis])

        return [(a, *sorted(others, key=partial(last, a))) for a, *others in ORDERS]

    def _matvec(self, x: NDArray) -> NDArray:
        volume = self.active.expand(as_float(x.ravel()))
        images = np.zeros(self.shape[0], volume.dtype)
        for axes in self._orders:
            self._project_along(axes, volume, images)
        return images

    def _project_along(self, axes: Axes, volume: NDArray, images: NDArray) -> None:
        """Add to ``images`` the sums along the rays with one long axis."""
        shares = self._shares(axes)
        if not shares:
            return
        shape, sums = turned(self.grid.shape, axes), running_sums(volume, self.grid.shape, axes)

        def follow(share: Share, courses: NDArray, pixel_ptr: NDArray) -> None:
            some = np.zeros(len(pixel_ptr) - 1)
            kernels.forward(courses, pixel_ptr, shape, self._number, *sums, some)
            share.add_to(images, some)

        follow_all(shares, self.grid, axes, follow)

    def _rmatvec(self, y: NDArray) -> NDArray:
        y = as_float(y.ravel())
        most = self._most(y)
        if not math.isfinite(most):  # which pixels are not is looked at here alone: they are many
            finite = np.isfinite(y)
            if not finite.all():
                return spoiled(self._rmatvec, y, finite)
            return np.full(self.shape[1], np.nan, y.dtype)
        volume = np.zeros(self.grid.size, y.dtype)
        if most > 0:
            per_unit = math.ldexp(1.0, min(61 - math.frexp(most)[1], 1023))
            for axes in self._orders:
                self._add_along(axes, y, per_unit, volume)
        return self.active.compress(volume)

    def _most(self, y: NDArray) -> float:
        """Return a bound of what all pixels ``y`` together add to a voxel."""
        step = math.sqrt(3) * max(self.grid.spacing)  # a voxel along the long axis, or less
        spans = zip(self._sources, self._ptr[:-1], self._ptr[1:], strict=True)
        total = sum(
            source.largest_weight * float(np.abs(y[start:stop]).sum(dtype=np.float64))
            for source, start, stop in spans
        )
        return step * total

    def _add_along(self, axes: Axes, y: NDArray, per_unit: float, volume: NDArray) -> None:
        """Add the back-projection along the rays with one long axis, some columns at a time.

        Of those a thread at a time has a range of its own, so that no two add to the same number.
        """
        shares = self._shares(axes)
        if not shares:
            return
        n_a, n_b, n_c = turned(self.grid.shape, axes)
        plane = n_c * (n_a + 1)  # numbers for each step along b
        room = max(volume.nbytes * 3 // 4, DIFFERENCES)
        passes = -(-n_b // max(room // (8 * plane), 1))
        steps = -(-n_b // passes)
        differences = np.zeros(steps * plane, np.uint64)
        for low in range(0, n_b, steps):
            columns = range(low, min(low + steps, n_b))
            if low > 0:  # new memory is zero, and touched first by the threads that add to it
                differences[:] = 0
            self._add_differences(shares, axes, columns, y, per_unit, differences)
            add_differences(differences, self.grid.shape, axes, columns, 1 / per_unit, volume)

    def _columns_met(self, axes: Axes, shares: Sequence[Share]) -> ColumnsMet:
        """Return which columns the shares along a long axis meet, which stay the same."""
        if axes not in self._met:
            self._met[axes] = columns_met(shares, self.grid, axes)
        return self._met[axes]

    def _add_differences(
        self,
        shares: Sequence[Share],
        axes: Axes,
        columns: range,
        y: NDArray,
        per_unit: float,
        differences: NDArray[np.uint64],
    ) -> None:
        """Add what shares bring to some columns along b, of which ``differences`` are."""
        shape = turned(self.grid.shape, axes)
        plane = shape[2] * (shape[0] + 1)
        threads = numba.get_num_threads()
        if threads == 1 and len(columns) == shape[1]:
            groups = [((0, shape[1]), shares)]
        else:
            groups = self._columns_met(axes, shares).groups(shares, columns, threads)

        def follow_in(some: tuple[int, int]) -> Follow:
            low, high = some
            mine = differences[(low - columns[0]) * plane : (high - columns[0]) * plane]

            def follow(share: Share, courses: NDArray, pixel_ptr: NDArray) -> None:
                kernels.adjoint(
                    courses, pixel_ptr, shape, self._number, low, high, per_unit, share.of(y), mine
                )

            return follow

        follow_groups(groups, self.grid, axes, follow_in)

    def _shares(self, axes: Axes) -> list[Share]:
        """Return the pixels with rays along ``axes[0]``, in shares."""
        return list(shares_of(self._sources, [along[axes[0]] for along in self._axes]))

    @property
    def _number(self) -> NDArray[np.integer]:
        """Nothing, of the type in which places of running sums fit."""
        return np.zeros(0, numbering(math.prod(n + 1 for n in self.grid.shape)))
