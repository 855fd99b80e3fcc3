"""The projector without a stored matrix: rays and chord lengths are computed at every product."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs import Camera
from tomo.grid import VoxelGrid
from tomo.live_voxels import LiveVoxels
from tomo.rays import Rays
from tomo.trace import column_changes
from tomo.trace.columns import add_differences, running_sums, turned
from tomo.trace.courses import WIDTH
from tomo.trace.sources import Numbers, PixelSource, RayPixels, pixel_source
from tomo.trace.survey import cuts_of_equal_work, survey
from tomo.viewed import ViewedOperator, as_float

RAYS_AT_ONCE = 65_536  # 4 MB of courses: fewer take as long to deal out as to follow

DIFFERENCES = 64 * 2**20  # bytes that an adjoint may take even for a smaller volume


class OnTheFlyProjector(ViewedOperator):
    """The same matrix as `tomo.projector.Projector`, never stored.

    Parameters
    ----------
    rays : Rays
    grid : VoxelGrid
    view_ptr : (views + 1,) int, optional
        Where each view's pixels begin; one view when None.
    live : LiveVoxels, optional
        The unknowns; all voxels when None.

    Notes
    -----
    Chord lengths are exact, in double precision relative to the grid. A product with float64 is
    good to about 1e-13 of the largest result. One with float32 reads running sums of the volume
    along one axis (`tomo.trace.column_changes`) rounded to single precision, so that its error is
    about 1e-7 of the largest such sum, not of the ray's own value: rays through nearly empty space
    beside bright voxels are less good relative to themselves. A voxel that is not finite spoils
    all rays that meet its columns.

    The adjoint has the same shares, rounded to whole multiples of 2^-61 of what all pixels
    together could add to a voxel at most; all sums of them are exact, so that a voxel that no ray
    meets gets zero. Results do not depend on the number of threads.

    A product takes the memory of one more volume, and 6 MB for the rays that it is at. Rays from
    cameras are made when needed: see `from_cameras`. Work grows with the rays' changes of column,
    not with the voxels that they meet: voxels that are not live are zeros.
    """

    def __init__(
        self,
        rays: Rays,
        grid: VoxelGrid,
        view_ptr: ArrayLike | None = None,
        live: LiveVoxels | None = None,
    ) -> None:
        self._set((RayPixels(rays),), grid, view_ptr, live)

    @classmethod
    def from_cameras(
        cls,
        cameras: Sequence[Camera],
        pixels: Sequence[NDArray[np.integer] | None] | None,
        grid: VoxelGrid,
        supersample: int = 1,
        live: LiveVoxels | None = None,
    ) -> OnTheFlyProjector:
        """Return the projector of cameras, one a view; 8 bytes a distorted ray, little else.

        A table of rays takes 64 bytes a ray.

        Parameters
        ----------
        cameras : sequence of Camera or RayTable
        pixels : sequence of (P_v,) int, optional
            For each camera its flat pixel numbers ``row * width + column``; all where None.
        grid : VoxelGrid
        supersample : int
            Rays along each side of a pixel, as in `Rays.from_camera`.
        live : LiveVoxels, optional
        """
        chosen = [None] * len(cameras) if pixels is None else pixels
        sources = tuple(
            pixel_source(camera, some, supersample)
            for camera, some in zip(cameras, chosen, strict=True)
        )
        return cls.from_sources(sources, grid, live)

    @classmethod
    def from_sources(
        cls, sources: Sequence[PixelSource], grid: VoxelGrid, live: LiveVoxels | None = None
    ) -> OnTheFlyProjector:
        """Return the projector of pixels with rays (`tomo.trace.sources`), one source a view."""
        view_ptr = np.cumsum([0] + [source.n_pixels for source in sources])
        return cls._of(tuple(sources), grid, view_ptr, live)

    @classmethod
    def _of(
        cls,
        sources: tuple[PixelSource, ...],
        grid: VoxelGrid,
        view_ptr: ArrayLike | None,
        live: LiveVoxels | None,
    ) -> OnTheFlyProjector:
        projector = cls.__new__(cls)
        projector._set(sources, grid, view_ptr, live)
        return projector

    def _set(self, sources, grid, view_ptr, live) -> None:
        self._sources = sources
        self._ptr = np.cumsum([0] + [source.n_pixels for source in sources])
        super().__init__(int(self._ptr[-1]), grid, view_ptr, np.float32, live)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<OnTheFlyProjector: {self.n_views} views, {self.shape[0]} pixels, {self.grid}>"

    @property
    def n_crossings(self) -> int:
        """How many crossings of rays with voxels there are, edges and corners aside."""
        return sum(crossings for _, crossings in self._surveys)

    def rows(self, start: int, stop: int) -> OnTheFlyProjector:
        """Return the projector of pixels ``start:stop`` as one view; rays are shared."""
        first, last = np.searchsorted(self._ptr, [start, stop], side="right") - 1
        wanted = []
        for number in range(first, min(last, len(self._sources) - 1) + 1):
            low, high = self._ptr[number : number + 2].tolist()
            if max(start, low) < min(stop, high):
                wanted.append((number, slice(max(start, low) - low, min(stop, high) - low)))
        return self._some(wanted, None)

    def _taken(
        self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]
    ) -> OnTheFlyProjector:
        source = np.searchsorted(self._ptr, pixels, side="right") - 1
        cuts = np.flatnonzero(np.diff(source)) + 1
        wanted = (
            [
                (int(number), some - self._ptr[number])
                for number, some in zip(
                    source[np.append(0, cuts)], np.split(pixels, cuts), strict=True
                )
            ]
            if len(pixels)
            else []
        )
        return self._some(wanted, view_ptr)

    def _some(
        self, wanted: Sequence[tuple[int, Numbers]], view_ptr: NDArray[np.int64] | None
    ) -> OnTheFlyProjector:
        """Return the projector of some pixels of some sources, one after another."""
        sources = tuple(self._sources[number].take(pixels) for number, pixels in wanted)
        projector = self._of(sources, self.grid, view_ptr, self.live)
        if "_axes" in self.__dict__:  # rays of some pixels go along no other axes
            projector.__dict__["_axes"] = [self._axes[number] for number, _ in wanted]
        return projector

    @cached_property
    def _axes(self) -> list[tuple[bool, bool, bool]]:
        """For each source, along which axes rays of it may go."""
        return [axes for axes, _ in self._surveys]

    @cached_property
    def _surveys(self) -> list[tuple[tuple[bool, bool, bool], int]]:
        """For each source, the axes along which its rays go, and their crossings with voxels."""
        found = (survey(source, self.grid) for source in self._sources)
        return [(one.axes, one.crossings) for one in found]

    def _matvec(self, x: NDArray) -> NDArray:
        volume = self.live.expand(as_float(x.ravel()))
        images = np.zeros(self.shape[0], volume.dtype)
        threads, number = numba.get_num_threads(), self._number
        for axis in range(3):
            shape = turned(self.grid.shape, axis)
            sums = None
            for block in self._blocks(axis):
                if sums is None:
                    sums = running_sums(volume, self.grid.shape, axis)
                some = np.zeros(len(block.pixel_ptr) - 1)
                column_changes.forward(
                    block.courses, block.pixel_ptr, shape, number, threads, *sums, some
                )
                block.add_to(images, some)
        return images

    def _rmatvec(self, y: NDArray) -> NDArray:
        y = as_float(y.ravel())
        finite = np.isfinite(y)
        if not finite.all():
            return self._with_spoiled(y, finite)
        volume = np.zeros(self.grid.size, y.dtype)
        most = self._most(y)
        if not math.isfinite(most):
            volume[:] = np.nan
        elif most > 0:
            per_unit = math.ldexp(1.0, min(61 - math.frexp(most)[1], 1023))
            for axis in range(3):
                if any(axes[axis] for axes in self._axes):
                    self._add_along(axis, y, per_unit, volume)
        return self.live.compress(volume)

    def _with_spoiled(self, y: NDArray, finite: NDArray[np.bool_]) -> NDArray:
        """Return the adjoint of pixels some of which are not finite: they reach what they see."""
        volume = self._rmatvec(np.where(finite, y, 0))
        with np.errstate(invalid="ignore"):  # infinity less infinity is not a number
            for value in np.unique(y[~finite]):
                same = np.isnan(y) if np.isnan(value) else y == value
                volume[self._rmatvec(same.astype(np.float64)) > 0] += value
        return volume

    def _most(self, y: NDArray) -> float:
        """Return a bound of what all pixels ``y`` together add to a voxel."""
        step = math.sqrt(3) * max(self.grid.spacing)  # a voxel along the long axis, or less
        spans = zip(self._sources, self._ptr[:-1], self._ptr[1:], strict=True)
        total = sum(
            source.largest_weight * float(np.abs(y[start:stop]).sum(dtype=np.float64))
            for source, start, stop in spans
        )
        return step * total

    def _add_along(self, axis: int, y: NDArray, per_unit: float, volume: NDArray) -> None:
        """Add the back-projection along the rays with one long axis, some columns at a time."""
        threads, number = numba.get_num_threads(), self._number
        shape = n_a, n_b, n_c = turned(self.grid.shape, axis)
        plane = n_c * (n_a + 1)  # numbers for each step along b
        at_once = -(-max(volume.nbytes, DIFFERENCES) // (8 * plane))
        ranges = -(-n_b // at_once)
        for part in range(ranges):
            low, high = part * n_b // ranges, (part + 1) * n_b // ranges
            differences = np.zeros((high - low) * plane, np.uint64)
            for block in self._blocks(axis):
                cuts = cuts_of_equal_work(block.courses, n_b, low, high, threads)
                column_changes.adjoint(
                    block.courses, block.pixel_ptr, shape, number, cuts, per_unit, block.of(y),
                    differences,
                )  # fmt: skip
            add_differences(differences, self.grid.shape, axis, low, 1 / per_unit, volume)

    @property
    def _number(self) -> NDArray[np.integer]:
        """Nothing, of the type in which places of running sums fit."""
        return np.zeros(0, np.int32 if math.prod(n + 1 for n in self.grid.shape) < 2**31 else int)

    def _blocks(self, axis: int) -> Iterator[_Block]:
        """Go through the rays along ``axis``, some at a time; a block is valid until the next."""
        room = np.zeros((0, WIDTH))  # used again: new memory costs more than what is written to it
        for pieces in self._shares(axis):
            ptrs = [self._sources[n].ray_ptr(start, stop) for n, start, stop in pieces]
            ends = np.cumsum([0] + [int(ptr[-1]) for ptr in ptrs])
            if len(room) < ends[-1]:
                room = np.zeros((max(int(ends[-1]), RAYS_AT_ONCE), WIDTH))
            courses = room[: ends[-1]]
            for (n, start, stop), low, high in zip(pieces, ends[:-1], ends[1:], strict=True):
                self._sources[n].write(start, stop, self.grid, axis, courses[low:high])
            ptr = np.concatenate(
                [np.zeros(1, np.int64)]
                + [ptr[1:] + low for ptr, low in zip(ptrs, ends[:-1], strict=True)]
            )
            spans = tuple((int(self._ptr[n]) + a, int(self._ptr[n]) + b) for n, a, b in pieces)
            yield _Block(courses, ptr, spans)

    def _shares(self, axis: int) -> Iterator[list[tuple[int, int, int]]]:
        """Go through the pixels with rays along ``axis``: lists of source, start and stop."""
        share, rays = [], 0
        for number, source in enumerate(self._sources):
            if not self._axes[number][axis]:
                continue
            for start, stop, count in source.portions(RAYS_AT_ONCE):
                if rays + count > RAYS_AT_ONCE and share:
                    yield share
                    share, rays = [], 0
                share.append((number, start, stop))
                rays += count
        if share:
            yield share


@dataclass(frozen=True, eq=False)
class _Block:
    """Courses of some rays with one long axis, and which pixels of the projector they feed."""

    courses: NDArray[np.float64]
    pixel_ptr: NDArray[np.int64]
    spans: tuple[tuple[int, int], ...]

    def of(self, images: NDArray) -> NDArray:
        """Return the pixels of the block, in double precision."""
        return np.concatenate([images[start:stop] for start, stop in self.spans], dtype=np.float64)

    def add_to(self, images: NDArray, some: NDArray) -> None:
        """Add ``some``, one value for each pixel of the block, to them."""
        at, some = 0, some.astype(images.dtype)
        for start, stop in self.spans:
            images[start:stop] += some[at : at + stop - start]
            at += stop - start
