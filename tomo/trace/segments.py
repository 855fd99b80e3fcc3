"""What a tracer returns: the voxels that each pixel's rays cross, and the lengths in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tomo._compute.grouping import index_type, take_groups
from tomo._compute.jit import compiled
from tomo.grid import VoxelGrid
from tomo.rays import Rays


@dataclass(frozen=True, eq=False)
class Segments:
    """The segments of rays in voxels, grouped by pixel: a sparse matrix in row order.

    Pixel ``p`` owns the entries ``ptr[p]:ptr[p + 1]``, ordered along each of its rays.

    Attributes
    ----------
    ptr : (pixels + 1,) int64
        Where each pixel's entries begin.
    voxel : (S,) int32 or int64
        Flat index of the voxel (the paper's impacting voxels).
    length : (S,) float32 or float64
        Segment length times the ray's quadrature weight, in the length unit: the matrix entry.
        With one ray a pixel the weight is 1.
    midpoint : (S, 3) float32 or float64, optional
        Midpoint of each segment (the paper's segment points) along the world's axes, measured
        from the grid's ``center``, so that single precision suffices wherever the grid lies.
    """

    ptr: NDArray[np.int64]
    voxel: NDArray[np.integer]
    length: NDArray[np.floating]
    midpoint: NDArray[np.floating] | None = None

    def __post_init__(self) -> None:
        """Check that the parts belong together."""
        if self.ptr.ndim != 1 or self.ptr.dtype != np.int64 or self.ptr[0] != 0:
            raise ValueError("segments ptr: expected an int64 vector that starts at 0")
        n_segments = int(self.ptr[-1])
        for name in ("voxel", "length"):
            shape = getattr(self, name).shape
            if shape != (n_segments,):
                raise ValueError(f"segments {name}: found shape {shape}, expected {(n_segments,)}")
        if self.midpoint is not None and self.midpoint.shape != (n_segments, 3):
            raise ValueError(
                f"segments midpoint: found shape {self.midpoint.shape}, expected {(n_segments, 3)}"
            )

    def __len__(self) -> int:
        """Return the number of segments."""
        return int(self.ptr[-1])

    def __repr__(self) -> str:
        """Name the sizes."""
        return (
            f"<Segments: {self.n_pixels} pixels, {len(self)} segments, "
            f"{self.nbytes / 2**20:.1f} MiB>"
        )

    @property
    def n_pixels(self) -> int:
        """Number of pixels, those without a segment included."""
        return len(self.ptr) - 1

    @property
    def nbytes(self) -> int:
        """Memory of the arrays in bytes."""
        arrays = (self.ptr, self.voxel, self.length, self.midpoint)
        return sum(a.nbytes for a in arrays if a is not None)

    def rows(self, start: int, stop: int) -> Segments:
        """Return the segments of pixels ``start:stop``; the entries are views, not copies."""
        return self._run(self.ptr[start : stop + 1])

    def take(self, pixels: NDArray[np.integer]) -> Segments:
        """Return copies of the segments of some pixels, in the order given."""
        return self._copied(*take_groups(self.ptr, pixels))

    def between(self, starts: NDArray[np.int64], stops: NDArray[np.int64]) -> Segments:
        """Return the segments of pixels that own the entries ``starts[p]:stops[p]`` of these.

        The entries are views when they lie one behind the other, else copies.
        """
        if len(starts) and (starts[1:] == stops[:-1]).all():
            return self._run(np.append(starts, stops[-1]))
        ends = np.stack([starts, stops], axis=1).ravel()
        return self._copied(*take_groups(ends, 2 * np.arange(len(starts))))

    def _run(self, ptr: NDArray[np.int64]) -> Segments:
        inside = slice(int(ptr[0]), int(ptr[-1]))
        midpoint = None if self.midpoint is None else self.midpoint[inside]
        return Segments(ptr - ptr[0], self.voxel[inside], self.length[inside], midpoint)

    def _copied(self, ptr: NDArray[np.int64], slots: NDArray[np.int64]) -> Segments:
        midpoint = None if self.midpoint is None else self.midpoint[slots]
        return Segments(ptr, self.voxel[slots], self.length[slots], midpoint)

    def renumbered(self, number: NDArray[np.integer]) -> Segments:
        """Return the segments in voxels that have a number, under that number.

        ``number`` holds one for every voxel, negative where it has none.
        """
        voxel = number[self.voxel]
        slots = np.flatnonzero(voxel >= 0)
        midpoint = None if self.midpoint is None else self.midpoint[slots]
        return Segments(
            np.searchsorted(slots, self.ptr),
            voxel[slots].astype(self.voxel.dtype),
            self.length[slots],
            midpoint,
        )

    def without_empty(self) -> tuple[Segments, NDArray[np.int64]]:
        """Return the pixels that cross a voxel, and their numbers; the entries are shared."""
        kept = np.flatnonzero(np.diff(self.ptr))
        ptr = np.append(self.ptr[kept], self.ptr[-1])
        return Segments(ptr, self.voxel, self.length, self.midpoint), kept

    @staticmethod
    def concatenate(parts: list[Segments]) -> Segments:
        """Return the segments of ``parts`` one after another; of a single one, itself."""
        if not parts:
            raise ValueError("segments to concatenate: found none, expected at least one")
        if len(parts) == 1:
            return parts[0]
        offsets = np.cumsum([0] + [len(part) for part in parts])
        ptr = [part.ptr[1:] + o for part, o in zip(parts, offsets[:-1], strict=True)]
        has_midpoint = all(part.midpoint is not None for part in parts)
        return Segments(
            np.concatenate([np.zeros(1, np.int64), *ptr]),
            np.concatenate([part.voxel for part in parts]),
            np.concatenate([part.length for part in parts]),
            np.concatenate([part.midpoint for part in parts]) if has_midpoint else None,
        )


def collect_by_pixel(
    rays: Rays,
    grid: VoxelGrid,
    counts: NDArray[np.int64],
    lengths: NDArray[np.float64],
    index: NDArray[np.int64],
    middles: NDArray[np.float64],
    *,
    midpoints: bool,
    dtype: DTypeLike,
) -> Segments:
    """Return `Segments` from those of each ray.

    ``counts`` (N,) of each ray, ``lengths`` (S,), the ``index`` (S, 3) of their voxels and their
    midpoints ``middles`` (S, 3) in voxel units.
    """
    voxel = np.ravel_multi_index(tuple(index.T), grid.shape).astype(index_type(grid.size))
    ray_ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    weighted = lengths * np.repeat(rays.weight, counts)
    from_center = (middles - np.asarray(grid.shape) / 2) * grid.spacing
    return Segments(
        ray_ptr[rays.pixel_ptr],
        voxel,
        weighted.astype(dtype),
        from_center.astype(dtype) if midpoints else None,
    )


def merging(tracer: Callable[[Rays], Segments], voxels: int) -> Callable[[Rays], Segments]:
    """Return the tracer whose lengths of a pixel in the same voxel are added up.

    Rays over an aperture cross few voxels that their neighbours do not: the matrix has a fraction
    of their segments. A pixel's voxels come in the order in which its rays first meet them.
    ``voxels`` is above every voxel number; midpoints, which differ from ray to ray, are left out.
    """
    last, done = np.full(voxels, -1), np.zeros(1, np.int64)

    def trace(rays: Rays) -> Segments:
        every = tracer(rays)
        ptr = np.zeros_like(every.ptr)
        voxel, length = np.zeros_like(every.voxel), np.zeros(len(every))
        merge(every.ptr, every.voxel, every.length, last, done, ptr, voxel, length)
        kept = int(ptr[-1])
        return Segments(ptr, voxel[:kept].copy(), length[:kept].astype(every.length.dtype))

    return trace


@compiled()
def merge(ptr, voxel, length, last, done, merged_ptr, merged_voxel, merged_length) -> None:
    """Write the merged entries.

    ``last`` (voxels,) has the number of each voxel's last entry; those below ``done[0]`` are of
    none.
    """
    first = end = done[0]
    for pixel in range(len(ptr) - 1):
        begin = end
        for s in range(ptr[pixel], ptr[pixel + 1]):
            entry = last[voxel[s]]
            if entry < begin:
                entry = end
                last[voxel[s]] = entry
                merged_voxel[entry - first] = voxel[s]
                end += 1
            merged_length[entry - first] += length[s]
        merged_ptr[pixel + 1] = end - first
    done[0] = end
