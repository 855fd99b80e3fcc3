"""The projector without a stored matrix: rays and chord lengths are computed at every product."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from rigs import Camera
from tomo.grid import VoxelGrid
from tomo.live_voxels import LiveVoxels
from tomo.rays import Rays
from tomo.trace import slabs
from tomo.trace.bricks import near_live
from tomo.trace.columns import across, add_columns, no_columns, to_columns
from tomo.trace.layers import fixed_point
from tomo.trace.sources import CameraPixels, Numbers, PixelSource, RayPixels
from tomo.trace.survey import cuts_of_equal_work, survey
from tomo.viewed import ViewedOperator, as_float

RAYS_AT_ONCE = 32_768  # 4 MB while their lengths are computed


class OnTheFlyProjector(ViewedOperator):
    """The same matrix as `tomo.projector.Projector`, never stored.

    Parameters
    ----------
    rays : Rays
    grid : VoxelGrid
    view_ptr : (views + 1,) int, optional
        Where each view's pixels begin; one view when None.
    live : LiveVoxels, optional
        The unknowns; all voxels when None. Rays step over space without any.

    Notes
    -----
    Chord lengths are exact: float64 up to where a ray enters the grid, fixed point of at least 20
    bits a voxel across the ray from there on, lengths in the type of the vector that is projected.
    In float32 a position along the ray is good to about 1e-7 of the grid's edge; a ray nearly
    parallel to a face passes it up to as much sooner or later as it is oblique, which moves length
    between the two neighbours. Forward and adjoint compute the same lengths (`tomo.trace.slabs`),
    so that they are each other's transpose to rounding. Results do not depend on the number of
    threads.

    A product takes the memory of one more volume, and 8 MB for the rays that it is at. Rays from
    cameras are made when they are needed: see `from_cameras`.
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
        """Return the projector of cameras, one a view; 4 bytes a pixel, and 8 a distorted ray.

        Parameters
        ----------
        cameras : sequence of Camera
        pixels : sequence of (P_v,) int, optional
            For each camera its flat pixel numbers ``row * width + column``; all where None.
        grid : VoxelGrid
        supersample : int
            Rays along each side of a pixel, as in `Rays.from_camera`.
        live : LiveVoxels, optional
        """
        chosen = [None] * len(cameras) if pixels is None else pixels
        sources = tuple(
            CameraPixels.of(camera, some, supersample)
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
        return sum(survey(source, self.grid).crossings for source in self._sources)

    def rows(self, start: int, stop: int) -> OnTheFlyProjector:
        """Return the projector of pixels ``start:stop`` as one view; rays are shared."""
        first, last = np.searchsorted(self._ptr, [start, stop], side="right") - 1
        wanted = []
        for number in range(first, min(last, len(self._sources) - 1) + 1):
            low, high = self._ptr[number : number + 2].tolist()
            if max(start, low) < min(stop, high):
                wanted.append((number, slice(max(start, low) - low, min(stop, high) - low)))
        return self._some(wanted, None)

    def with_live(self, live: LiveVoxels) -> OnTheFlyProjector:
        """Return the projector of the same rays for other unknowns."""
        projector = self._of(self._sources, self.grid, self.view_ptr, live)
        self._hand_down(projector, range(len(self._sources)))
        return projector

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
        self._hand_down(projector, [number for number, _ in wanted])
        return projector

    def _hand_down(self, projector: OnTheFlyProjector, origin: Sequence[int]) -> None:
        """Tell a projector of some of the pixels what is known of their sources already."""
        if "_axes" in self.__dict__:
            projector.__dict__["_axes"] = [self._axes[number] for number in origin]
        if projector.live is self.live and "_bricks" in self.__dict__:
            projector.__dict__["_bricks"] = self._bricks

    @cached_property
    def _axes(self) -> list[tuple[bool, bool, bool]]:
        """For each source, along which axes rays of it may go."""
        return [survey(source, self.grid).axes for source in self._sources]

    @cached_property
    def _bricks(self) -> NDArray[np.uint8]:
        """Where live voxels are near; empty where all are live."""
        return np.zeros((0, 0, 0), np.uint8) if self.live.all else near_live(self.live.mask)

    def _matvec(self, x: NDArray) -> NDArray:
        volume = self.live.expand(as_float(x.ravel()))
        images = np.zeros(self.shape[0], volume.dtype)
        threads = numba.get_num_threads()
        for axis in range(3):
            columns = None
            for block in self._blocks(axis, volume.dtype):
                if columns is None:
                    columns = to_columns(volume, self.grid.shape, axis)
                some = np.zeros(len(block.pixel_ptr) - 1, volume.dtype)
                slabs.forward(*block.courses, *self._space(axis), threads, columns, some)
                block.add_to(images, some)
        return images

    def _rmatvec(self, y: NDArray) -> NDArray:
        y = as_float(y.ravel())
        volume = np.zeros(self.grid.size, y.dtype)
        threads = numba.get_num_threads()
        for axis in range(3):
            columns = None
            for block in self._blocks(axis, y.dtype):
                if columns is None:
                    columns = no_columns(self.grid.shape, axis, y.dtype)
                own, cuts = cuts_of_equal_work(
                    block.whole, block.bits, _turned(self.grid.shape, axis), threads
                )
                slabs.adjoint(*block.courses, *self._space(axis), cuts, own, block.of(y), columns)
            if columns is not None:
                add_columns(columns, self.grid.shape, axis, volume)
        return self.live.compress(volume)

    def _space(self, axis: int) -> tuple[NDArray[np.uint8], tuple[int, int, int]]:
        """Return the bricks, flat, and the steps between them along the axes a, b and c."""
        _, ny, nz = self._bricks.shape
        return self._bricks.ravel(), _turned((ny * nz, nz, 1), axis)

    def _blocks(self, axis: int, dtype: DTypeLike) -> Iterator[_Block]:
        """Go through the rays along ``axis``, some at a time; a block is valid until the next."""
        number, bits = fixed_point(self.grid.shape, dtype)
        shape = _turned(self.grid.shape, axis)
        for pieces in self._shares(axis):
            ptrs = [self._sources[n].ray_ptr(start, stop) for n, start, stop in pieces]
            ends = np.cumsum([0] + [int(ptr[-1]) for ptr in ptrs])
            pixels = np.cumsum([0] + [stop - start for _, start, stop in pieces])[:-1]
            whole, real = np.zeros((ends[-1], 8), np.int64), np.zeros((ends[-1], 5))
            for (n, start, stop), low, high in zip(pieces, ends[:-1], ends[1:], strict=True):
                self._sources[n].write(
                    start, stop, self.grid, axis, bits, whole[low:high], real[low:high]
                )
            ptr = np.concatenate(
                [np.zeros(1, np.int64)]
                + [ptr[1:] + low for ptr, low in zip(ptrs, ends[:-1], strict=True)]
            )
            order = np.concatenate(
                [
                    self._sources[n].order(start, stop) + low
                    for (n, start, stop), low in zip(pieces, pixels, strict=True)
                ]
            )
            spans = tuple((int(self._ptr[n]) + a, int(self._ptr[n]) + b) for n, a, b in pieces)
            yield _Block(whole, real, ptr, order, shape, bits, np.zeros(0, number), spans)

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

    whole: NDArray[np.int64]
    real: NDArray[np.float64]
    pixel_ptr: NDArray[np.int64]
    order: NDArray[np.int64]
    shape: tuple[int, int, int]
    bits: int
    number: NDArray[np.integer]
    spans: tuple[tuple[int, int], ...]

    @property
    def courses(self) -> tuple:
        return (
            self.whole, self.real, self.pixel_ptr, self.order, self.shape, self.bits, self.number,
        )  # fmt: skip

    def of(self, images: NDArray) -> NDArray:
        """Return the pixels of the block."""
        return np.concatenate([images[start:stop] for start, stop in self.spans])

    def add_to(self, images: NDArray, some: NDArray) -> None:
        """Add ``some``, one value for each pixel of the block, to them."""
        at = 0
        for start, stop in self.spans:
            images[start:stop] += some[at : at + stop - start]
            at += stop - start


def _turned(values: tuple[int, int, int], axis: int) -> tuple[int, int, int]:
    """Return what belongs to x, y and z in the order of a long axis a, b and c."""
    b, c = across(axis)
    return values[axis], values[b], values[c]
